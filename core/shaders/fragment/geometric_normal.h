// geometric_normal: the normal of the triangle's plane.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Output: f32, 3 components, world axes, unit length, by the right-handed winding; 0 for degenerate triangles.
struct GeometricNormalShader : FragmentShaderTraits {
  static constexpr bool kIsFraction = true;
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput&) { return true; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    out.f[0] = in.geometric_normal.x;
    out.f[1] = in.geometric_normal.y;
    out.f[2] = in.geometric_normal.z;
  }
};

}  // namespace voxelpipe
