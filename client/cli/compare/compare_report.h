// The output of `voxelpipe compare`.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "compare/comparison.h"
#include "engine/report.h"

namespace voxelpipe::cli {

// The object of --json. Numbers that JSON cannot hold are null.
nlohmann::ordered_json ComparisonJson(const StoredResult& a, const StoredResult& b, double tolerance,
                                      const Comparison& comparison);
// The same as a short table.
Lines ComparisonTable(const StoredResult& a, const StoredResult& b, double tolerance, const Comparison& comparison);

}  // namespace voxelpipe::cli
