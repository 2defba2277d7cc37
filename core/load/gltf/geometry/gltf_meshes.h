// Meshes of a document, with the copies that nodes with their own morph weights need.
#pragma once

#include "absl/status/status.h"
#include "load/gltf/geometry/gltf_primitives.h"
#include "mesh/scene/scene.h"

namespace tinygltf {
class Model;
}

namespace voxelpipe::gltf {

// In: the model; `scene` with nodes and skins read. Out: scene.meshes, as many as the file's plus copies for nodes that
// override morph weights (those nodes' `mesh` then points at the copy). Every joint with a weight is proved to exist in
// the skin of each node that uses the mesh.
// Errors: INVALID_ARGUMENT, RESOURCE_EXHAUSTED, as ReadPrimitive.
absl::Status ReadMeshes(const tinygltf::Model& model, PrimitiveContext& context, Scene& scene);

}  // namespace voxelpipe::gltf
