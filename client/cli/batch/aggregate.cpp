#include "batch/aggregate.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "batch/manifest.h"
#include "batch/shard.h"
#include "encode/atomic_file.h"
#include "options/together.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

template <typename... Parts>
absl::Status Wrong(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat(parts...));
}

constexpr int64_t kMaxLine = 100'000'000;  // of a list; each takes 12 bytes

enum class Outcome : uint8_t { kMissing, kDone, kFailed };

// An item of one report.
struct Entry {
  uint32_t line = 0;
  Outcome outcome = Outcome::kMissing;
  bool made = false, warned = false;  // made by the run of the report
  uint64_t bytes = 0;
  size_t failure = 0;  // its number among those of the report
};

struct Report {
  std::string path, manifest, sha256, ended;
  std::string wrong;  // why it is none; empty if it is one
  Shard shard;
  std::vector<Entry> entries;
  std::vector<FailedItem> failures;
  std::vector<FailureReason> reasons;  // of each failure
};

// "path: accessor 17: out of range" of all items becomes "accessor N: out of range".
FailureReason ReasonOf(const FailedItem& item, const std::string& input) {
  std::string text =
      input.empty() ? item.message : absl::StrReplaceAll(item.message, {{input + ": ", ""}, {input, "the input"}});
  std::string general;
  for (const char c : text) {
    if (c < '0' || c > '9') {
      general += c;
    } else if (general.empty() || general.back() != 'N') {
      general += 'N';
    }
  }
  return {item.code, general, item.permanent};
}

void AddItem(const ordered_json& json, Report& report) {
  Entry entry;
  const auto line = json.at("line").get<int64_t>();
  if (line < 1 || line > kMaxLine) {
    report.wrong = absl::StrCat("an item of line ", line);
    return;
  }
  entry.line = uint32_t(line);
  const std::string status = json.at("status").get<std::string>();
  if (status == "failed") {
    const ordered_json& error = json.at("error");
    entry.outcome = Outcome::kFailed;
    entry.failure = report.failures.size();
    report.failures.push_back({entry.line, json.at("id").get<std::string>(), error.at("code").get<std::string>(),
                               error.at("message").get<std::string>(), error.at("permanent").get<bool>()});
    report.reasons.push_back(ReasonOf(report.failures.back(), json.at("input").get<std::string>()));
  } else if (status == "done" || status == "skipped") {
    entry.outcome = Outcome::kDone;
    entry.made = status == "done";
    const auto warnings = json.find("warnings");
    entry.warned = warnings != json.end() && !warnings->empty();
    entry.bytes = json.at("bytes").get<uint64_t>();
  } else {
    return;  // left
  }
  report.entries.push_back(entry);
}

absl::StatusOr<Report> ReadReport(const std::string& path) {
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  if (!file) return Wrong(path, ": cannot be read: ", std::strerror(errno));
  Report report;
  report.path = path;
  bool in_items = false;
  // Each item is dropped as soon as it is taken.
  const auto take_items = [&](int depth, ordered_json::parse_event_t event, ordered_json& parsed) {
    if (depth == 1 && event == ordered_json::parse_event_t::key) in_items = parsed == "items";
    if (!in_items || depth != 2 || event != ordered_json::parse_event_t::object_end) return true;
    AddItem(parsed, report);
    return false;
  };
  try {
    const ordered_json json = ordered_json::parse(file, take_items);
    report.manifest = json.at("manifest").get<std::string>();
    report.sha256 = json.at("manifest_sha256").get<std::string>();
    report.ended = json.at("ended").get<std::string>();
    const absl::StatusOr<Shard> shard = ParseShard(json.at("shard").get<std::string>());
    if (!shard.ok()) return Wrong(path, ": is no report of batch: ", std::string(shard.status().message()));
    report.shard = *shard;
  } catch (const nlohmann::json::exception& error) {
    return Wrong(path, ": is no report of batch: ", error.what());
  }
  if (!report.wrong.empty()) return Wrong(path, ": is no report of batch: ", report.wrong);
  return report;
}

// The outcome of each line, of reports from the oldest to the newest.
class Outcomes {
 public:
  void Apply(const Report& report, size_t number) {
    for (const Entry& entry : report.entries) {
      if (lines_.size() <= entry.line) lines_.resize(entry.line + 1);
      Line& line = lines_[entry.line];
      if (entry.made && line.made < 2) ++line.made;
      line.report = uint32_t(number);
      line.entry = uint32_t(&entry - report.entries.data());
      line.known = true;
    }
  }
  bool Knows(size_t line) const { return line < lines_.size() && lines_[line].known; }
  const Entry& EntryOf(size_t line, const std::vector<Report>& reports) const {
    return reports[lines_[line].report].entries[lines_[line].entry];
  }
  const Report& ReportOf(size_t line, const std::vector<Report>& reports) const { return reports[lines_[line].report]; }
  bool IsRepeated(size_t line) const { return lines_[line].made > 1; }

 private:
  struct Line {
    uint32_t report = 0, entry = 0;
    uint8_t made = 0;  // by how many runs, at most 2
    bool known = false;
  };
  std::vector<Line> lines_;
};

std::string NameIn(std::string_view line) {
  const ordered_json json = ordered_json::parse(line, nullptr, /*allow_exceptions=*/false);
  for (const char* key : {"id", "name", "output", "input"}) {
    if (!json.is_object() || !json.contains(key)) continue;
    return json[key].is_string() ? json[key].get<std::string>() : json[key].dump();
  }
  return "";
}

std::vector<std::string> ShardsWithoutReport(const std::vector<Report>& reports) {
  std::map<uint64_t, std::set<uint64_t>> seen;  // of each number of shards
  for (const Report& report : reports) seen[report.shard.count].insert(report.shard.index % report.shard.count);
  std::vector<std::string> without;
  constexpr size_t kMost = 1000;
  for (const auto& [count, indexes] : seen) {
    for (uint64_t i = 0; i < count && without.size() < kMost; ++i) {
      if (!indexes.contains(i)) without.push_back(absl::StrCat(i, "/", count));
    }
  }
  return without;
}

// The line with absolute paths in place of relative ones, which are searched beside the list.
std::string WithAbsolutePaths(std::string_view line, const std::string& directory) {
  ordered_json json = ordered_json::parse(line, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) return std::string(line);
  const auto make_absolute = [&](ordered_json& object, const char* key) {
    const auto found = object.find(key);
    if (found == object.end() || !found->is_string()) return;
    std::error_code ignored;  // only where the working directory is gone
    *found = fs::absolute(FindBeside(directory, found->get<std::string>()), ignored).string();
  };
  for (const char* key : {"input", "grid_like", "grid-like"}) make_absolute(json, key);
  if (const auto meshes = json.find("meshes"); meshes != json.end() && meshes->is_array()) {
    for (ordered_json& mesh : *meshes) {
      if (mesh.is_object()) make_absolute(mesh, "input");
    }
  }
  return JsonText(json);
}

}  // namespace

int Aggregate::exit_code() const {
  if (missing > 0 || failed > permanent) return 1;
  return failed > 0 ? 3 : 0;
}

absl::StatusOr<Aggregate> AggregateReports(const std::vector<std::string>& paths) {
  std::vector<Report> reports;
  for (const std::string& path : paths) {
    absl::StatusOr<Report> report = ReadReport(path);
    if (!report.ok()) return report.status();
    if (!reports.empty() && report->sha256 != reports[0].sha256) {
      return Wrong(path, ": is of another list than ", reports[0].path, "; aggregate them apart");
    }
    reports.push_back(*std::move(report));
  }
  std::stable_sort(reports.begin(), reports.end(), [](const Report& a, const Report& b) { return a.ended < b.ended; });
  Outcomes outcomes;
  for (size_t i = 0; i < reports.size(); ++i) outcomes.Apply(reports[i], i);

  Aggregate all;
  all.manifest = reports.back().manifest;
  all.reports = reports.size();
  const auto add = [&](size_t line, size_t, std::string_view text) {
    ++all.items;
    if (!outcomes.Knows(line)) {
      ++all.missing;
      all.missing_items.push_back({line, NameIn(text)});
      return;
    }
    const Entry& entry = outcomes.EntryOf(line, reports);
    if (outcomes.IsRepeated(line)) ++all.repeated;
    if (entry.outcome == Outcome::kDone) {
      ++all.done;
      all.warned += entry.warned ? 1 : 0;
      all.bytes += entry.bytes;
      return;
    }
    const Report& report = outcomes.ReportOf(line, reports);
    const FailedItem& failure = report.failures[entry.failure];
    ++all.failed;
    all.permanent += failure.permanent ? 1 : 0;
    FailureCount& reason = all.reasons[report.reasons[entry.failure]];
    if (reason.count++ == 0) reason.example = failure;
    all.failed_items.push_back(failure);
  };
  const absl::StatusOr<ManifestFacts> facts = ScanManifest(all.manifest, add);
  if (!facts.ok()) return facts.status();
  if (facts->sha256 != reports[0].sha256) {
    return Wrong(all.manifest, ": has changed since ", reports.back().path, " was written; run batch again");
  }
  if (all.missing > 0) all.shards_without_report = ShardsWithoutReport(reports);
  return all;
}

absl::Status WriteRetryList(const Aggregate& aggregate, const std::string& path) {
  const std::string directory = fs::path(aggregate.manifest).parent_path().string();
  std::error_code error;
  const fs::path parent = fs::path(path).parent_path();
  const bool beside =
      fs::equivalent(parent.empty() ? "." : parent, directory.empty() ? "." : directory, error) && !error;
  std::set<size_t> left;
  for (const FailedItem& item : aggregate.failed_items) left.insert(item.line);
  for (const MissingItem& item : aggregate.missing_items) left.insert(item.line);
  absl::StatusOr<AtomicFile> file = AtomicFile::Create(path);
  if (!file.ok()) return file.status();
  absl::Status written = absl::OkStatus();
  const auto write = [&](size_t line, size_t, std::string_view text) {
    if (!written.ok() || !left.contains(line)) return;
    const std::string whole = (beside ? std::string(text) : WithAbsolutePaths(text, directory)) + "\n";
    written = file->Write({reinterpret_cast<const uint8_t*>(whole.data()), whole.size()});
  };
  if (const auto facts = ScanManifest(aggregate.manifest, write); !facts.ok()) return facts.status();
  return written.ok() ? file->Commit() : written;
}

ordered_json AggregateJson(const Aggregate& all) {
  ordered_json json = {{"manifest", all.manifest}, {"reports", all.reports},   {"items", all.items},
                       {"done", all.done},         {"failed", all.failed},     {"permanent", all.permanent},
                       {"missing", all.missing},   {"repeated", all.repeated}, {"warned", all.warned},
                       {"bytes", all.bytes}};
  json["reasons"] = ordered_json::array();
  for (const auto& [reason, count] : all.reasons) {
    json["reasons"].push_back({{"code", reason.code},
                               {"reason", reason.text},
                               {"permanent", reason.permanent},
                               {"count", count.count},
                               {"example", {{"line", count.example.line}, {"id", count.example.id}}}});
  }
  json["failed_items"] = ordered_json::array();
  for (const FailedItem& item : all.failed_items) {
    json["failed_items"].push_back({{"line", item.line},
                                    {"id", item.id},
                                    {"code", item.code},
                                    {"message", item.message},
                                    {"permanent", item.permanent}});
  }
  json["missing_items"] = ordered_json::array();
  for (const MissingItem& item : all.missing_items) {
    json["missing_items"].push_back({{"line", item.line}, {"id", item.id}});
  }
  json["shards_without_report"] = all.shards_without_report;
  return json;
}

Lines AggregateTable(const Aggregate& all) {
  constexpr size_t kMaxReasons = 20, kMaxShards = 10;
  Lines lines = {absl::StrCat(all.manifest, ": ", WithCommas(all.items), " items, ", all.reports,
                              all.reports == 1 ? " report" : " reports")};
  const std::string warned = all.warned == 0 ? "" : absl::StrCat(", ", WithCommas(all.warned), " with warnings");
  lines.push_back(TableRow("done", absl::StrCat(WithCommas(all.done), ", ", HumanBytes(all.bytes), warned)));
  lines.push_back(TableRow("failed", absl::StrCat(WithCommas(all.failed), all.failed == 0 ? "" : ", ",
                                                  all.failed == 0 ? "" : WithCommas(all.permanent),
                                                  all.failed == 0 ? "" : " of them permanently")));
  // The most frequent first.
  std::vector<std::pair<FailureReason, FailureCount>> reasons(all.reasons.begin(), all.reasons.end());
  std::stable_sort(reasons.begin(), reasons.end(),
                   [](const auto& a, const auto& b) { return a.second.count > b.second.count; });
  for (size_t i = 0; i < std::min(reasons.size(), kMaxReasons); ++i) {
    const auto& [reason, count] = reasons[i];
    lines.push_back(absl::StrCat("    ", WithCommas(count.count), " x ", reason.code,
                                 reason.permanent ? "" : " (may pass)", ": ", reason.text, "; line ",
                                 count.example.line, ", ", count.example.id));
  }
  if (reasons.size() > kMaxReasons) {
    lines.push_back(absl::StrCat("    and ", reasons.size() - kMaxReasons, " further reasons (--json)"));
  }
  lines.push_back(TableRow("missing", WithCommas(all.missing)));
  if (!all.shards_without_report.empty()) {
    std::string shards;
    for (size_t i = 0; i < std::min(all.shards_without_report.size(), kMaxShards); ++i) {
      absl::StrAppend(&shards, shards.empty() ? "" : ", ", all.shards_without_report[i]);
    }
    const size_t more = all.shards_without_report.size() - std::min(all.shards_without_report.size(), kMaxShards);
    lines.push_back(
        absl::StrCat("    no report of shards ", shards, more == 0 ? "" : absl::StrCat(" and ", more, " more")));
  }
  return lines;
}

}  // namespace voxelpipe::cli
