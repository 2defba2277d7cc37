// The report of `voxelpipe bench`.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "bench/load.h"
#include "engine/report.h"

namespace voxelpipe::cli {

// The object of `bench --json`. Times are milliseconds, percentiles those of Histogram: over responses without error,
// and over the failures of each code.
nlohmann::ordered_json BenchJson(const LoadPlan& plan, const LoadResult& result);
// The same as a short table.
Lines BenchTable(const LoadPlan& plan, const LoadResult& result);

}  // namespace voxelpipe::cli
