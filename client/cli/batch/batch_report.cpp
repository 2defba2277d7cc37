#include "batch/batch_report.h"

#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "base/text.h"
#include "engine/report.h"

namespace voxelpipe::cli {
namespace {

const char* Name(ItemStatus status) {
  switch (status) {
    case ItemStatus::kLeft: return "left";
    case ItemStatus::kDone: return "done";
    case ItemStatus::kSkipped: return "skipped";
    case ItemStatus::kFailed: return "failed";
  }
  return "";
}

nlohmann::ordered_json ItemJson(const BatchItem& item, const ItemReport& report) {
  nlohmann::ordered_json json;
  json["id"] = item.id;
  json["line"] = item.line;
  json["input"] = item.input;
  json["output"] = item.output;
  json["status"] = Name(report.status);
  if (!report.error.ok()) {
    json["error"] = {{"code", absl::StatusCodeToString(report.error.code())},
                     {"message", ErrorText(report.error)},
                     {"permanent", report.permanent}};
  }
  json["ms"] = report.milliseconds;
  json["attempts"] = report.attempts;
  if (!report.server.empty()) json["server"] = report.server;
  if (!report.worker.empty()) json["worker"] = report.worker;
  if (report.status != ItemStatus::kDone && report.status != ItemStatus::kSkipped) return json;
  json["hash"] = report.hash;
  json["bytes"] = report.bytes;
  json["files"] = report.files;
  AddWarnings(report.warnings, json);
  return json;
}

}  // namespace

BatchTotals TotalsOf(const BatchResult& result) {
  BatchTotals totals;
  totals.items = result.items.size();
  for (const ItemReport& item : result.items) {
    if (!item.warnings.empty()) ++totals.warned;
    switch (item.status) {
      case ItemStatus::kLeft: ++totals.left; break;
      case ItemStatus::kDone:
        ++totals.done;
        totals.bytes += item.bytes;
        break;
      case ItemStatus::kSkipped: ++totals.skipped; break;
      case ItemStatus::kFailed:
        ++totals.failed;
        totals.permanent += item.permanent ? 1 : 0;
        break;
    }
  }
  return totals;
}

nlohmann::ordered_json TotalsJson(const BatchResult& result) {
  const BatchTotals totals = TotalsOf(result);
  return {{"items", totals.items}, {"done", totals.done},     {"skipped", totals.skipped}, {"failed", totals.failed},
          {"left", totals.left},   {"warned", totals.warned}, {"bytes", totals.bytes},     {"seconds", result.seconds}};
}

nlohmann::ordered_json ReportJson(const BatchPlan& plan, const BatchResult& result) {
  nlohmann::ordered_json json;
  json["manifest"] = plan.manifest;
  json["output_dir"] = plan.output_dir;
  json["shard"] = absl::StrCat(plan.shard.index, "/", plan.shard.count);
  if (!plan.servers.empty()) json["servers"] = plan.servers;
  json["totals"] = TotalsJson(result);
  if (!result.gone.ok()) json["error"] = ErrorText(result.gone);
  json["items"] = nlohmann::ordered_json::array();
  for (size_t i = 0; i < plan.items.size(); ++i) json["items"].push_back(ItemJson(plan.items[i], result.items[i]));
  return json;
}

WarningList WarningsOf(const BatchPlan& plan, const BatchResult& result) {
  WarningList all;
  for (size_t i = 0; i < result.items.size(); ++i) {
    const WarningList& warnings = result.items[i].warnings;
    for (const Warning& warning : warnings.kept()) {
      all.Add(warning.code, absl::StrCat(plan.items[i].id, warning.place.empty() ? "" : ": ", warning.place),
              warning.text);
    }
    all.set_left_out(all.left_out() + warnings.left_out());
  }
  return all;
}

std::string TotalsLine(const BatchResult& result) {
  const BatchTotals totals = TotalsOf(result);
  std::string line = absl::StrCat(WithCommas(totals.items), " items: ", WithCommas(totals.done), " done, ",
                                  WithCommas(totals.skipped), " done before, ", WithCommas(totals.failed), " failed");
  if (totals.warned > 0) absl::StrAppend(&line, ", ", WithCommas(totals.warned), " with warnings");
  if (totals.left > 0) absl::StrAppend(&line, ", ", WithCommas(totals.left), " left");
  return absl::StrCat(line, absl::StrFormat("; %.1f s, ", result.seconds), HumanBytes(totals.bytes), " of results");
}

}  // namespace voxelpipe::cli
