// The graph part of a glTF document (scenes, nodes, meshes, skins, materials), checked before tinygltf sees it.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "base/warning.h"
#include "load/limits.h"

namespace voxelpipe::gltf {

// In: the parsed document. Out: a new document that has only what the loader uses, with every type and index checked,
// and harmless placeholders for accessors and buffers, so that tinygltf neither sees data nor rejects what it does not
// understand. Faults of materials are dropped with a line in `warnings`; faults of geometry are errors.
// Errors: INVALID_ARGUMENT naming the object.
absl::StatusOr<nlohmann::json> SanitizeGraph(const nlohmann::json& root, const LoadLimits& limits,
                                             WarningList& warnings);

}  // namespace voxelpipe::gltf
