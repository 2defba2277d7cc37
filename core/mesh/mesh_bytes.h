// What meshes take of memory, computed from sizes.
#pragma once

#include <cstdint>

#include "mesh/scene/scene.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// Bytes of the arrays, images included; small parts (names, nodes, materials) are left out, unless a file can make many
// of them out of few bytes: primitives, animations, morph targets and their weights.
uint64_t SceneBytes(const Scene& scene);
// The same; the rig counts with the mesh, though what it shares with the scene stays in memory once.
uint64_t MeshBytes(const TriangleMesh& mesh);

}  // namespace voxelpipe
