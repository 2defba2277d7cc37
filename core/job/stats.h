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
  // Of a grid that the request gives: triangles whose boxes lie beside it, after the vertex shader. 0 of fitted grids.
  uint64_t triangles_outside = 0;
  std::optional<uint64_t> fragments;  // (triangle, voxel) pairs touched; absent on paths that do not count them
  // Voxels with a fragment or fill; counted after the pipeline, outside its time, except where counting waits for a
  // device.
  uint64_t occupied = 0;
  int passes = 1;  // number of runs over all slabs: a stream of several targets, or planes, has one for each
  std::optional<uint64_t> odd_columns;  // with parity fill: columns with an odd number of crossings
  std::string backend;                  // "cpu" or "cuda"
  std::string device_failure;           // why the device that was tried first failed; empty if it did not
  std::string simd = "scalar";
  std::vector<std::string> path;  // the path of each target: "occupancy", "tiles", ... (core/README.md)
  // Stage name -> wall milliseconds, in order of execution, those that ran:
  // vertex_shade plan coarse_raster tile_sort fine_raster emit sort resolve fill.
  std::vector<std::pair<std::string, double>> stages;
  double voxelize_ms = 0;      // mesh in memory to result in memory, clearing included
  double voxelize_cpu_ms = 0;  // CPU time of the process over the same span
  WarningList warnings;        // of the mesh, of the textures that the request's shaders read, and of the run
};

}  // namespace voxelpipe
