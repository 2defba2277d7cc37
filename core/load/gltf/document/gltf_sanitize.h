// The graph part of a glTF document (scenes, nodes, meshes, skins, materials), checked before tinygltf sees it.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "base/warning.h"
#include "mesh/scene/load_limits.h"

namespace voxelpipe::gltf {

inline constexpr uint64_t kMaxElements = 1'000'000;  // of any one array; nodes have their own limit

// In: the parsed document. Out: a new document with only the members that the loader uses, every type and index
// checked, so that BuildModel can rely on it; it takes no more memory than `root`. The job is polled between elements.
// Faults of materials are dropped with a line in `warnings`; faults of geometry are errors. Errors: INVALID_ARGUMENT
// naming the object; RESOURCE_EXHAUSTED past max_nodes; the job's.
absl::StatusOr<nlohmann::json> SanitizeGraph(const JobContext& job, const nlohmann::json& root,
                                             const LoadLimits& limits, WarningList& warnings);

}  // namespace voxelpipe::gltf
