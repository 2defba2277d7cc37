// The meshes and grids of the GPU table.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "grid/grid_spec.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe::gpu {

struct BenchMesh {
  std::string name;                    // the name in the rows of the table
  std::string what;                    // its description
  std::function<TriangleMesh()> make;  // in [0, 1]^3
};

// cow, bunny, bunny1M, sphere10M, nasty. `bunny` is a mesh file, a bunny of 69,451 triangles; without it a generated
// sphere of as many. `cow` is a mesh file, or a decimation of the bunny.
std::vector<BenchMesh> BenchMeshes(const std::string& bunny, const std::string& cow);

// [0, 1]^3 in n^3 voxels.
GridRequest UnitCube(int64_t n);

// The flattened scene of a file, textures prepared; ends the process if it cannot be read.
TriangleMesh LoadMeshOrExit(const std::string& path);

}  // namespace voxelpipe::gpu
