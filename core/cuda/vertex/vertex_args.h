// Arguments of the vertex shading kernels. No host-only includes.
#pragma once

#include <cstdint>

#include "shaders/interface/motion_run.h"
#include "shaders/interface/vertex.h"

namespace voxelpipe::cuda {

// Null arrays are not read or not written. Outputs may alias inputs.
struct VertexArgs {
  ShaderParams params;
  uint64_t count = 0;
  const Vec3d* positions = nullptr;  // as flattened, world space
  const Vec3f* normals = nullptr;
  const Vec4f* tangents = nullptr;
  const PosedPartView* posed =
      nullptr;  // one per part of the mesh, replaces the arrays above; null: the request has no pose
  const uint64_t* first_vertex = nullptr;  // per part of the mesh
  uint32_t part_count = 0;
  const MotionRun* motions = nullptr;  // of placed meshes; null: none of them moves by itself
  uint32_t motion_count = 0;
  Vec3d* shaded_positions = nullptr;
  Vec3f* shaded_normals = nullptr;
  Vec4f* shaded_tangents = nullptr;
  Vec3f* velocities = nullptr;
};

}  // namespace voxelpipe::cuda
