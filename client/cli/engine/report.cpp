#include "engine/report.h"

#include <sys/resource.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "base/text.h"
#include "encode/part_json.h"

namespace voxelpipe::cli {
namespace {

double Median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const size_t middle = values.size() / 2;
  return values.size() % 2 == 1 ? values[middle] : (values[middle - 1] + values[middle]) / 2;
}

nlohmann::ordered_json OrNull(const std::optional<uint64_t>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json(nullptr);
}

std::vector<std::pair<std::string, double>> AllStages(const EngineRun& run, const VoxelizeReport& report,
                                                      const MedianTimes& times) {
  std::vector<std::pair<std::string, double>> stages = run.mesh_stages;
  stages.insert(stages.end(), times.stages.begin(), times.stages.end());
  if (report.encoded) stages.emplace_back("encode", report.encode_ms);
  return stages;
}

}  // namespace

void PrintError(std::string_view where, std::string_view message) {
  constexpr size_t kMaxLineBytes = 8192;  // a path is up to 4,096 bytes, and twice in it at most
  const std::string line =
      absl::StrCat("voxelpipe: ", std::string(where), where.empty() ? "" : ": ", std::string(message));
  WriteLine(stderr, CleanText(line, kMaxLineBytes));
}

void PrintError(std::string_view where, const absl::Status& status) {
  const std::string message = ErrorText(status);  // the same text as from a server
  PrintError(where, message.empty() ? absl::StatusCodeToString(status.code()) : message);
}

void PrintWarnings(std::string_view where, const WarningList& warnings) {
  constexpr size_t kMaxLines = 5;
  const std::string prefix = where.empty() ? "warning" : absl::StrCat(std::string(where), ": warning");
  const std::vector<Warning>& kept = warnings.kept();
  for (size_t i = 0; i < std::min(kMaxLines, kept.size()); ++i) PrintError(prefix, kept[i].Line());
  if (kept.size() <= kMaxLines) return;
  PrintError(prefix, absl::StrCat("and ", WithCommas(kept.size() - kMaxLines + warnings.left_out()), " more"));
}

void AddWarnings(const WarningList& warnings, nlohmann::ordered_json& json) {
  json["warnings"] = nlohmann::ordered_json::array();
  for (const Warning& warning : warnings.kept()) {
    json["warnings"].push_back(
        {{"code", std::string(Name(warning.code))}, {"place", warning.place}, {"text", warning.text}});
  }
  if (warnings.left_out() > 0) json["warnings_left_out"] = warnings.left_out();
}

absl::Status PrintLines(const Lines& lines) {
  for (const std::string& line : lines) {
    errno = 0;
    if (WriteLine(stdout, line)) continue;
    return absl::DataLossError(
        absl::StrCat("cannot write to standard output", errno == 0 ? "" : absl::StrCat(": ", std::strerror(errno))));
  }
  return absl::OkStatus();
}

absl::Status PrintLine(const std::string& line) {
  return PrintLines({line});
}

std::string TableRow(std::string_view name, std::string_view text, int width) {
  return absl::StrCat(absl::StrFormat("  %-*s", width, std::string(name)), std::string(text));
}

std::string JsonText(const nlohmann::ordered_json& json, int indent) {
  return JsonTextOf(json, indent);
}

MedianTimes Medians(const std::vector<VoxelizeStats>& runs) {
  MedianTimes times;
  for (const auto& [name, unused] : runs.front().stages) {
    std::vector<double> values;
    for (const VoxelizeStats& run : runs) {
      for (const auto& [other, ms] : run.stages) {
        if (other == name) values.push_back(ms);
      }
    }
    times.stages.emplace_back(name, Median(values));
  }
  std::vector<double> wall, cpu;
  for (const VoxelizeStats& run : runs) {
    wall.push_back(run.voxelize_ms);
    cpu.push_back(run.voxelize_cpu_ms);
  }
  times.voxelize_ms = Median(wall);
  times.voxelize_cpu_ms = Median(cpu);
  times.voxelize_cpu_ms_min = *std::min_element(cpu.begin(), cpu.end());
  return times;
}

namespace {

// "wing, label 3, 1,204 triangles, 5,402 voxels" of the part of a number.
std::string PartText(const PartTable& parts, size_t i) {
  const std::string name(parts.Name(i));
  std::string text = absl::StrCat(name.empty() ? "(no name)" : name, ", label ", parts.label[i], ", ",
                                  WithCommas(parts.triangles[i]), " triangles");
  if (parts.voxels.empty()) return text;
  absl::StrAppend(&text, ", ", WithCommas(parts.voxels[i]), " voxels");
  if (parts.open_edges[i] > 0) absl::StrAppend(&text, ", ", WithCommas(parts.open_edges[i]), " open edges");
  return text;
}

constexpr size_t kPartsShown = 12;

}  // namespace

nlohmann::ordered_json VoxelizeJson(const EngineRun& run, const VoxelizeReport& report) {
  const ResultHeader& result = report.header;
  const VoxelizeStats& stats = run.runs.back();
  const MedianTimes times = Medians(run.runs);
  nlohmann::ordered_json json;
  json["input"] = report.input;
  json["triangles"] = stats.triangles;
  json["triangles_outside"] = stats.triangles_outside;
  json["dims"] = result.grid.dims;
  json["origin"] = {result.grid.origin.x, result.grid.origin.y, result.grid.origin.z};
  json["voxel_size"] = {result.grid.voxel_size.x, result.grid.voxel_size.y, result.grid.voxel_size.z};
  json["occupied"] = stats.occupied;
  json["fragments"] = OrNull(stats.fragments);
  json["odd_columns"] = OrNull(stats.odd_columns);
  json["open_edges"] = OrNull(run.open_edges);
  if (!report.parts.empty()) json["parts"] = PartsJson(report.parts);
  json["backend"] = stats.backend;
  json["simd"] = stats.simd;
  json["path"] = stats.path;
  if (!stats.device_failure.empty()) json["device_failure"] = stats.device_failure;
  if (stats.passes > 1) json["passes"] = stats.passes;
  json["result"] = Name(result.kind);
  json["bytes"] = report.bytes;
  json["peak_bytes"] = report.peak_bytes;
  json["hash"] = report.hash;
  nlohmann::ordered_json stages = nlohmann::ordered_json::object();
  for (const auto& [name, ms] : AllStages(run, report, times)) stages[name] = ms;
  json["stages"] = stages;
  json["voxelize_ms"] = times.voxelize_ms;
  json["voxelize_cpu_ms"] = times.voxelize_cpu_ms;
  if (run.runs.size() > 1) {
    json["voxelize_cpu_ms_min"] = times.voxelize_cpu_ms_min;
    json["repeat"] = run.runs.size();
  }
  if (run.served) {
    json["worker"] = run.served->worker;
    json["queue_ms"] = run.served->queue_ms;
    json["batch_jobs"] = run.served->batch_jobs;
    json["attempts"] = run.served->attempts;
    json["cached"] = run.served->cached;
    json["result_bytes"] = report.bytes;
    json["sent_bytes"] = run.served->sent_bytes;
  }
  json["files"] = report.files;
  AddWarnings(run.warnings, json);
  return json;
}

Lines VoxelizeTable(const EngineRun& run, const VoxelizeReport& report) {
  const ResultHeader& result = report.header;
  const VoxelizeStats& stats = run.runs.back();
  const MedianTimes times = Medians(run.runs);
  Lines table = {report.input};
  const auto row = [&](const char* name, const std::string& text) { table.push_back(TableRow(name, text)); };
  const auto& dims = result.grid.dims;
  const Vec3d& h = result.grid.voxel_size;
  row("triangles", absl::StrCat(WithCommas(stats.triangles),
                                stats.triangles_outside == 0 ? ""
                                                             : absl::StrCat(", ", WithCommas(stats.triangles_outside),
                                                                            " of them outside the grid")));
  row("grid", absl::StrCat(dims[0], " x ", dims[1], " x ", dims[2], " voxels of ",
                           h.x == h.y && h.y == h.z ? absl::StrFormat("%.6g", h.x)
                                                    : absl::StrFormat("%.6g x %.6g x %.6g", h.x, h.y, h.z)));
  row("origin", absl::StrFormat("%.10g %.10g %.10g", result.grid.origin.x, result.grid.origin.y, result.grid.origin.z));
  row("occupied",
      absl::StrCat(
          WithCommas(stats.occupied),
          absl::StrFormat(" (%.2f %%), ", 100.0 * double(stats.occupied) / double(result.grid.voxels())),
          stats.fragments ? absl::StrCat(WithCommas(*stats.fragments), " fragments") : "fragments not counted"));
  if (stats.odd_columns) row("odd columns", WithCommas(*stats.odd_columns));
  if (run.open_edges) row("open edges", WithCommas(*run.open_edges));
  for (size_t i = 0; i < std::min(report.parts.size(), kPartsShown); ++i) {
    row(i == 0 ? "parts" : "", PartText(report.parts, i));
  }
  if (report.parts.size() > kPartsShown) {
    row("", absl::StrCat("and ", report.parts.size() - kPartsShown, " more"));
  }
  for (size_t i = 0; i < result.specs.size(); ++i) {
    row(i == 0 ? "targets" : "",
        absl::StrCat(DescribeTarget(result.specs[i]), ", ", HumanBytes(result.arrays[result.lists() + i].bytes())));
  }
  row("backend", absl::StrCat(stats.backend, ", ", stats.simd, run.server_peak_bytes ? ", on the server" : ""));
  if (!stats.device_failure.empty()) row("in place of", stats.device_failure);
  if (run.served && !run.served->worker.empty()) {
    row("worker",
        absl::StrCat(run.served->worker, ", after ", absl::StrFormat("%.1f ms in the queue", run.served->queue_ms),
                     run.served->batch_jobs > 1 ? absl::StrCat(", with ", run.served->batch_jobs - 1, " others") : "",
                     run.served->attempts > 1 ? absl::StrCat(", at attempt ", run.served->attempts) : "",
                     run.served->cached ? ", shared with an equal request" : ""));
  }
  if (run.served && run.served->sent_bytes < report.bytes) {
    row("sent", absl::StrCat(HumanBytes(run.served->sent_bytes), " of ", HumanBytes(report.bytes), ", compressed"));
  }
  row("peak memory", HumanBytes(report.peak_bytes));
  row("sha-256", report.hash);
  std::string stages;
  for (const auto& [name, ms] : AllStages(run, report, times)) {
    absl::StrAppend(&stages, stages.empty() ? "" : ", ", name, absl::StrFormat(" %.1f", ms));
  }
  row("stages, ms", stages);
  std::string total = absl::StrFormat("%.1f ms, %.1f ms of CPU", times.voxelize_ms, times.voxelize_cpu_ms);
  if (run.runs.size() > 1) {
    absl::StrAppend(&total, absl::StrFormat(" (medians of %d; least CPU %.1f ms)", int(run.runs.size()),
                                            times.voxelize_cpu_ms_min));
  }
  row("voxelize", total);
  for (size_t i = 0; i < report.files.size(); ++i) row(i == 0 ? "wrote" : "", report.files[i]);
  return table;
}

std::string WithCommas(uint64_t number) {
  const std::string digits = std::to_string(number);
  std::string text;
  for (size_t i = 0; i < digits.size(); ++i) {
    if (i > 0 && (digits.size() - i) % 3 == 0) text += ',';
    text += digits[i];
  }
  return text;
}

std::string HumanBytes(uint64_t bytes) {
  if (bytes < 1024) return absl::StrCat(bytes, " bytes");
  constexpr const char* kUnits[] = {"KiB", "MiB", "GiB", "TiB"};
  double value = double(bytes) / 1024;
  int unit = 0;
  for (; value >= 1024 && unit < 3; ++unit) value /= 1024;
  return absl::StrFormat("%.1f %s", value, kUnits[unit]);
}

std::string DescribeTarget(const TargetSpec& target) {
  std::string text(Name(target.format));
  if (target.components > 1) absl::StrAppend(&text, "x", target.components);
  return absl::StrCat(text, ":", std::string(Name(target.blend)), " of ", target.shader.name);
}

uint64_t ProcessPeakBytes() {
  // Not getrusage, where a child starts with its parent's maximum.
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind("VmHWM:", 0) == 0) return std::strtoull(line.c_str() + 6, nullptr, 10) * 1024;  // in KiB
  }
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return uint64_t(usage.ru_maxrss) * 1024;
}

}  // namespace voxelpipe::cli
