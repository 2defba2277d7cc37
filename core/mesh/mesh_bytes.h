// The memory of meshes, computed from sizes.
#pragma once

#include <cstdint>

#include "mesh/scene/scene.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// Bytes of the arrays, including images, without small parts (names, nodes, materials), but with those that a file can
// declare in large numbers with few bytes: primitives, animations, morph targets and their weights.
uint64_t SceneBytes(const Scene& scene);
// The same; includes the rig, although it shares parts with the scene.
uint64_t MeshBytes(const TriangleMesh& mesh);

}  // namespace voxelpipe
