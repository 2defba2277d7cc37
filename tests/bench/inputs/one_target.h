// Requests of the tables of whole calls.
#pragma once

#include "job/request.h"

namespace voxelpipe::bench {

inline VoxelizeRequest OneTarget(VoxelFormat format, int components, Blend blend, const char* shader,
                                 ResultKind result) {
  VoxelizeRequest request;
  TargetSpec& target = request.targets[0];
  target.format = format;
  target.components = components;
  target.blend = blend;
  target.shader.name = shader;
  request.result = result;
  return request;
}

}  // namespace voxelpipe::bench
