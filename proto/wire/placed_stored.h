// A stored mesh that is placed on the grid of a request, beside others.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "base/vec.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// PlacedMesh (mesh/placed_mesh.h) with the name of a stored mesh in place of the mesh.
struct PlacedStored {
  std::string mesh;                            // StoredMesh::name
  Mat4d matrix{};                              // CheckPlacement
  std::string name{};                          // empty: `mesh`
  std::optional<uint32_t> label{};             // at least 1; absent: its number in the list, from 1
  int32_t priority = 0;                        // of the parts that it has
  std::optional<RigidMotionNumbers> motion{};  // of its triangles, after placing; absent: it does not move
};

}  // namespace voxelpipe
