// The one place where tinygltf runs.
#pragma once

#include <string>

#include "absl/status/statusor.h"

namespace tinygltf {
class Model;
}

namespace voxelpipe::gltf {

// In: Document::graph. Out: its scenes, nodes, meshes, skins, materials, textures and samplers; the other arrays are
// placeholders. Never opens a file. Errors: INVALID_ARGUMENT with tinygltf's first line.
absl::StatusOr<tinygltf::Model> ParseGraph(const std::string& graph);

}  // namespace voxelpipe::gltf
