// What `voxelpipe bench` prints.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "bench/load.h"

namespace voxelpipe::cli {

// The object of `bench --json`. Times are milliseconds, percentiles those of Histogram: over answers without error, and
// over the failures of each code.
nlohmann::ordered_json BenchJson(const LoadPlan& plan, const LoadResult& result);
// The same for people: a short table.
std::string BenchTable(const LoadPlan& plan, const LoadResult& result);

}  // namespace voxelpipe::cli
