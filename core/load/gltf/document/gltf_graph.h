// The graph part of a document in tinygltf's structures.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "absl/status/statusor.h"
#include "load/gltf/document/gltf_buffers.h"

namespace tinygltf {
class Model;
}

namespace voxelpipe::gltf {

// In: Document::graph. Out: its scenes, nodes, meshes, skins, materials, textures and samplers; the other arrays are
// empty. The model is charged to `charge`, and the job is polled meanwhile. Errors: RESOURCE_EXHAUSTED; the job's. May
// throw bad_alloc and nlohmann's exceptions, which a checked graph never does.
absl::StatusOr<tinygltf::Model> BuildModel(const nlohmann::json& graph, const Budget& budget, MemoryCharge& charge);

}  // namespace voxelpipe::gltf
