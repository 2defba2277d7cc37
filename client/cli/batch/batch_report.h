// The report of a run of `voxelpipe batch`.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "batch/batch_run.h"

namespace voxelpipe::cli {

struct BatchTotals {
  size_t items = 0, done = 0, skipped = 0, failed = 0, left = 0;
  size_t permanent = 0;  // of those that failed
  size_t warned = 0;     // of the finished ones, now or before, with warnings
  uint64_t bytes = 0;    // of the results that this run made
};
BatchTotals TotalsOf(const BatchResult& result);

// {"items", "done", "skipped", "failed", "left", "warned", "bytes", "seconds"}.
nlohmann::ordered_json TotalsJson(const BatchResult& result);
// The whole report: the totals, and every item with its status, error, time and files.
nlohmann::ordered_json ReportJson(const BatchPlan& plan, const BatchResult& result);
// The warnings of all items, each with its item's name before the location.
WarningList WarningsOf(const BatchPlan& plan, const BatchResult& result);
// A summary of one line.
std::string TotalsLine(const BatchResult& result);

}  // namespace voxelpipe::cli
