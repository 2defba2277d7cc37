// The rows of the GPU table: cases with their mesh, grid and target time.
#pragma once

#include <string>
#include <vector>

#include "job/request.h"

namespace voxelpipe::gpu {

struct BenchRow {
  std::string mesh;  // of BenchMeshes
  std::string name;  // of the case
  int64_t n = 0;     // the grid is [0, 1]^3 in n^3 voxels
  double pass_ms = 0, stretch_ms = 0;
  VoxelizeRequest request;  // grid included
};

// In the order of BenchMeshes.
std::vector<BenchRow> BenchRows();

// Shaders as users run them: meshes with normals, texture coordinates, a texture and an attribute. Occupied voxels
// differ from those of bits where a shader discards. Without target times; the ratios count.
std::vector<BenchRow> ShaderRows();

// Requests of whole calls, from a mesh on the host to a result on the host, and of the times of single stages; without
// target times.
std::vector<BenchRow> WholeCallRows();
std::vector<BenchRow> StageRows();

}  // namespace voxelpipe::gpu
