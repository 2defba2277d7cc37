// Counts and times of one run.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace voxelpipe {

struct VoxelizeStats {
  uint64_t triangles = 0;
  uint64_t fragments = 0;  // (triangle, voxel) pairs touched
  uint64_t occupied = 0;   // voxels with a fragment or filled; counted after the pipeline, outside its time
  std::optional<uint64_t> odd_columns;  // with parity fill: columns with an odd number of crossings
  std::string backend;                  // "cpu" or "cuda"
  std::string simd = "scalar";
  // Stage name -> wall milliseconds, in order of execution, those that ran:
  // vertex_shade coarse_raster tile_sort fine_raster fill.
  std::vector<std::pair<std::string, double>> stages;
  double voxelize_ms = 0;      // mesh in memory to result in memory, clearing included
  double voxelize_cpu_ms = 0;  // CPU time of the process over the same span
};

}  // namespace voxelpipe
