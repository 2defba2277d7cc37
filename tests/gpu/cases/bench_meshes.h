// The meshes and grids of the GPU table.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "grid/grid_spec.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe::gpu {

struct BenchMesh {
  std::string name;                    // as the table's rows name it
  std::string what;                    // what stands for it
  std::function<TriangleMesh()> make;  // in [0, 1]^3
};

// cow, bunny, bunny1M, sphere10M, nasty. `bunny` is a mesh file, a bunny of 69,451 triangles; without it a generated
// sphere of as many stands in. A decimation of it stands in for the cow, or the mesh file `cow`.
std::vector<BenchMesh> BenchMeshes(const std::string& bunny, const std::string& cow);

// [0, 1]^3 in n^3 voxels.
GridRequest UnitCube(int64_t n);

// The flattened scene of a file, textures prepared; ends the process where it cannot be read.
TriangleMesh LoadMeshOrExit(const std::string& path);

}  // namespace voxelpipe::gpu
