// Requests that several tests of the service make.
#pragma once

#include "job/request.h"

namespace voxelpipe::testing {

inline VoxelizeRequest SmallRequest() {
  VoxelizeRequest request;
  request.grid.resolution = 16;
  return request;
}

// A few milliseconds of one core for each triangle of LargeTrianglesGlb (servers that get it have --threads 1), in a
// small result: 20,000 of them take a minute or more.
inline VoxelizeRequest SlowRequest() {
  VoxelizeRequest request;
  request.grid.resolution = 256;
  request.targets[0].format = VoxelFormat::kF32;
  request.targets[0].blend = Blend::kMax;
  request.targets[0].shader = {"barycentric", {}};
  return request;
}

}  // namespace voxelpipe::testing
