#include "batch/batch_report.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "base/text.h"
#include "encode/output_path.h"
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

// Those of a file, which a killed process left behind.
void RemoveTemporaries(const std::string& path) {
  const absl::StatusOr<std::string> file = FollowLinks(path);
  if (!file.ok()) return;  // creating the file reports the error
  const std::string stem = AtomicFile::TemporaryStem(*file);
  const std::filesystem::path parent = std::filesystem::path(*file).parent_path();
  std::error_code ignored;
  for (std::filesystem::directory_iterator at(parent.empty() ? "." : parent, ignored), end; !ignored && at != end;
       at.increment(ignored)) {
    std::error_code gone;
    const std::string name = (parent / at->path().filename()).string();
    if (AtomicFile::StemOf(name) == stem) std::filesystem::remove(name, gone);
  }
}

}  // namespace

nlohmann::ordered_json TotalsJson(const BatchResult& result) {
  const BatchTotals& totals = result.totals;
  return {{"items", totals.items}, {"done", totals.done},     {"skipped", totals.skipped}, {"failed", totals.failed},
          {"left", totals.left},   {"warned", totals.warned}, {"bytes", totals.bytes},     {"seconds", result.seconds}};
}

std::string TotalsLine(const BatchResult& result) {
  const BatchTotals& totals = result.totals;
  std::string line = absl::StrCat(WithCommas(totals.items), " items: ", WithCommas(totals.done), " done, ",
                                  WithCommas(totals.skipped), " done before, ", WithCommas(totals.failed), " failed");
  if (totals.warned > 0) absl::StrAppend(&line, ", ", WithCommas(totals.warned), " with warnings");
  if (totals.left > 0) absl::StrAppend(&line, ", ", WithCommas(totals.left), " left");
  return absl::StrCat(line, absl::StrFormat("; %.1f s, ", result.seconds), HumanBytes(totals.bytes), " of results");
}

absl::StatusOr<ReportWriter> ReportWriter::Create(const std::string& path, const BatchPlan& plan) {
  std::error_code ignored;  // creating the file reports the error
  const std::filesystem::path parent = std::filesystem::path(path).parent_path();
  if (!parent.empty()) std::filesystem::create_directories(parent, ignored);
  RemoveTemporaries(path);
  absl::StatusOr<AtomicFile> file = AtomicFile::Create(path);
  if (!file.ok()) return file.status();
  ReportWriter report(*std::move(file), plan.shard);
  nlohmann::ordered_json json;
  json["manifest"] = std::filesystem::absolute(plan.manifest, ignored).string();
  json["output_dir"] = plan.output_dir;
  json["shard"] = absl::StrCat(plan.shard.index, "/", plan.shard.count);
  if (!plan.servers.empty()) json["servers"] = plan.servers;
  std::string text = JsonText(json);
  text.back() = ',';
  report.Write(text + "\n\"items\": [");
  return report;
}

ReportWriter::ReportWriter(AtomicFile file, const Shard& shard)
    : file_(std::move(file)), shard_(shard), next_(shard.index % shard.count) {}

void ReportWriter::Write(const std::string& text) {
  if (status_.ok()) status_ = file_.Write({reinterpret_cast<const uint8_t*>(text.data()), text.size()});
}

void ReportWriter::Add(const BatchItem& item, const ItemReport& report) {
  held_.emplace(item.number, JsonText(ItemJson(item, report)));
  while (!held_.empty() && (held_.begin()->first <= next_ || held_.size() > kMaxHeld)) {
    next_ = std::max(next_, held_.begin()->first + shard_.count);
    Write(absl::StrCat(std::exchange(any_, true) ? ",\n" : "\n", held_.begin()->second));
    held_.erase(held_.begin());
  }
}

absl::Status ReportWriter::Finish(const BatchResult& result, const ManifestFacts& manifest) {
  for (const auto& [number, text] : held_) Write(absl::StrCat(std::exchange(any_, true) ? ",\n" : "\n", text));
  held_.clear();
  nlohmann::ordered_json json;
  json["totals"] = TotalsJson(result);
  for (const absl::Status& error : {result.gone, result.list}) {
    if (!error.ok()) json["error"] = ErrorText(error);
  }
  json["manifest_items"] = manifest.items;
  json["manifest_sha256"] = manifest.sha256;
  json["ended"] = absl::FormatTime("%Y-%m-%dT%H:%M:%E6SZ", absl::Now(), absl::UTCTimeZone());
  Write(absl::StrCat("\n],\n", JsonText(json).substr(1), "\n"));
  return status_.ok() ? file_.Commit() : status_;
}

}  // namespace voxelpipe::cli
