// `voxelpipe aggregate`: the reports of several runs of `voxelpipe batch` on one list, as one.
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "engine/report.h"

namespace voxelpipe::cli {

// An item that failed, by the last report that has it.
struct FailedItem {
  size_t line = 0;
  std::string id, code, message;
  bool permanent = false;
};

struct MissingItem {
  size_t line = 0;
  std::string id;  // or output, or input; empty if the line gives none
};

// What failed items have in common.
struct FailureReason {
  std::string code, text;  // the message, without the item's input and with N in place of numbers
  bool permanent = false;
  friend auto operator<=>(const FailureReason&, const FailureReason&) = default;
};
struct FailureCount {
  size_t count = 0;
  FailedItem example;  // the first in the list
};

struct Aggregate {
  std::string manifest;
  size_t reports = 0;
  // items = done + failed + missing; permanent ones are among the failed, and those with warnings among the done.
  size_t items = 0, done = 0, failed = 0, permanent = 0, missing = 0, warned = 0;
  size_t repeated = 0;  // items that more than one run made, because their input, options or files had changed
  uint64_t bytes = 0;   // of the results of done items
  std::map<FailureReason, FailureCount> reasons;
  std::vector<FailedItem> failed_items;            // in the order of the list
  std::vector<MissingItem> missing_items;          // that no report has
  std::vector<std::string> shards_without_report;  // "i/n", if items are missing

  // As that of batch: 0 if all is done, 3 if only permanent errors are left, otherwise 1.
  int exit_code() const;
};

// In: paths of reports. Of an item that several have, the one that ended last counts. Memory: some 30 bytes an item,
// and the failed and missing ones. Errors: INVALID_ARGUMENT naming the report that is none, that is of another list, or
// whose list has changed since; the system's if a report or the list cannot be read.
absl::StatusOr<Aggregate> AggregateReports(const std::vector<std::string>& paths);

// Writes the lines of the list that failed or are missing to `path`, for another run of `batch` with the same options.
// In another directory than the list's the paths of inputs become absolute. Errors: the system's.
absl::Status WriteRetryList(const Aggregate& aggregate, const std::string& path);

nlohmann::ordered_json AggregateJson(const Aggregate& aggregate);
// A short table.
Lines AggregateTable(const Aggregate& aggregate);

}  // namespace voxelpipe::cli
