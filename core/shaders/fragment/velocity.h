// velocity: the velocity of the surface.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Output: f32, 3 components: the vertex shader's velocities interpolated, world axes, world units a second; 0 if it
// outputs none.
struct VelocityShader : FragmentShaderTraits {
  static constexpr bool kNeedsBarycentrics = true;
  static constexpr bool kIsFraction = true;
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput& in) { return in.mesh->velocities == nullptr; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    const Vec3f* velocities = in.mesh->velocities;
    if (velocities == nullptr) return;
    const Vec3f v =
        Interpolate(in.barycentric, velocities[in.vertex[0]], velocities[in.vertex[1]], velocities[in.vertex[2]]);
    out.f[0] = v.x;
    out.f[1] = v.y;
    out.f[2] = v.z;
  }
};

}  // namespace voxelpipe
