// The meshes of parity cases: each is difficult for some kernel.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "mesh/triangle_mesh.h"

namespace voxelpipe::gpu {

// Made on demand. Coordinates lie about [0, extent], so that a grid of `extent` voxels of size 1 holds the mesh; extent
// 0: they lie anywhere, and grids are fitted.
struct ParityMesh {
  std::string name;
  double extent = 40;
  std::function<TriangleMesh()> make;
  bool refusable = false;  // some vertex is not finite or so far away that requests may be refused, by both alike
};

// More than thirty, the same ones for the same seed.
std::vector<ParityMesh> ParityMeshes(uint32_t seed);

}  // namespace voxelpipe::gpu
