// position: the point of the triangle that represents the voxel.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Output: f32, 3 components, world units: the shaded vertices interpolated with the barycentrics, in double, rounded
// once. It lies on the triangle, near the voxel's centre, and may lie outside the voxel. Degenerate triangles: their
// centroid.
struct PositionShader : FragmentShaderTraits {
  static constexpr bool kNeedsBarycentrics = true;
  static constexpr bool kIsFraction = true;
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    const Vec3d* p = in.mesh->positions;
    const Vec3d v0 = p[in.vertex[0]], e1 = p[in.vertex[1]] - v0, e2 = p[in.vertex[2]] - v0;
    // Relative to a vertex: the weights sum to 1 only up to rounding, which would shift a mesh far from the origin.
    const Vec3d at = v0 + (e1 * double(in.barycentric.y) + e2 * double(in.barycentric.z));
    out.f[0] = float(at.x);
    out.f[1] = float(at.y);
    out.f[2] = float(at.z);
  }
};

}  // namespace voxelpipe
