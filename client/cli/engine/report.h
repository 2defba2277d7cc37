// The output of `voxelpipe`. Every line goes through WriteLine (base/text.h): names and texts in it may come from a
// file or from a server. A text of several lines is a list of lines, so that no name in one can begin another.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "absl/status/status.h"
#include "engine/engine.h"
#include "job/stats.h"

namespace voxelpipe::cli {

// `voxelpipe: WHERE: message`, one line on stderr for every message. `where` may be empty.
void PrintError(std::string_view where, const absl::Status& status);
void PrintError(std::string_view where, std::string_view message);

// Each warning as `voxelpipe: WHERE: warning: PLACE: TEXT` on stderr, at most five, then how many more there are.
void PrintWarnings(std::string_view where, const WarningList& warnings);

// json["warnings"], an array of {code, place, text}, and json["warnings_left_out"] if there are more than are kept.
void AddWarnings(const WarningList& warnings, nlohmann::ordered_json& json);

using Lines = std::vector<std::string>;  // without their newlines

// Writes each line and a newline to stdout. DATA_LOSS if writing fails.
absl::Status PrintLines(const Lines& lines);
absl::Status PrintLine(const std::string& line);

// The row of a table, indented: a name, padded to `width` columns, and a text.
std::string TableRow(std::string_view name, std::string_view text, int width = 12);

// The text of a JSON value, to print or for a file; on one line if `indent` is negative. What is not UTF-8 in its
// strings, such as a path, is replaced, and every control character is escaped.
std::string JsonText(const nlohmann::ordered_json& json, int indent = -1);

struct VoxelizeReport {
  std::string input;
  ResultHeader header;             // of the result
  PartTable parts;                 // likewise
  uint64_t bytes = 0;              // of all arrays
  std::vector<std::string> files;  // written
  std::string hash;
  double encode_ms = 0;
  bool encoded = false;
  uint64_t peak_bytes = 0;
};

// Times of several runs: for each stage and total the median, and the smallest CPU time.
struct MedianTimes {
  std::vector<std::pair<std::string, double>> stages;  // in order of execution
  double voxelize_ms = 0, voxelize_cpu_ms = 0, voxelize_cpu_ms_min = 0;
};
MedianTimes Medians(const std::vector<VoxelizeStats>& runs);

// The object of `voxelize --json`.
nlohmann::ordered_json VoxelizeJson(const EngineRun& run, const VoxelizeReport& report);
// The same as a short table.
Lines VoxelizeTable(const EngineRun& run, const VoxelizeReport& report);

// "12,345,678"; "1.5 GiB"; "bit:or occupancy".
std::string WithCommas(uint64_t number);
std::string HumanBytes(uint64_t bytes);
std::string DescribeTarget(const TargetSpec& target);

// Peak resident memory of this process, bytes.
uint64_t ProcessPeakBytes();

}  // namespace voxelpipe::cli
