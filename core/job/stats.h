// Counts and times of one run.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/warning.h"

namespace voxelpipe {

struct VoxelizeStats {
  uint64_t triangles = 0;
  std::optional<uint64_t> fragments;  // (triangle, voxel) pairs touched; absent where a fast path does not count them
  // Voxels with a fragment or filled; counted after the pipeline, outside its time but where that waits for a device.
  uint64_t occupied = 0;
  int passes = 1;  // times that all slabs were made: a stream of several targets, or planes, makes them for each
  std::optional<uint64_t> odd_columns;  // with parity fill: columns with an odd number of crossings
  std::string backend;                  // "cpu" or "cuda"
  std::string device_failure;           // why a device that was tried first did not do it; empty where none was
  std::string simd = "scalar";
  std::vector<std::string> path;  // what made each target: "occupancy", "tiles", ... (core/README.md)
  // Stage name -> wall milliseconds, in order of execution, those that ran:
  // vertex_shade coarse_raster tile_sort fine_raster emit sort resolve fill.
  std::vector<std::pair<std::string, double>> stages;
  double voxelize_ms = 0;      // mesh in memory to result in memory, clearing included
  double voxelize_cpu_ms = 0;  // CPU time of the process over the same span
  WarningList warnings;        // of the mesh, of the textures that the request's shaders read, and of the run
};

}  // namespace voxelpipe
