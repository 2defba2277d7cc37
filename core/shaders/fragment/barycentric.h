// barycentric: the barycentric coordinates of the voxel's centre, projected onto the triangle.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Output: f32, 3 components: the weights of the triangle's vertices, not negative, with the sum 1 up to rounding.
struct BarycentricShader : FragmentShaderTraits {
  static constexpr bool kIsFraction = true;
  static constexpr bool kNeedsBarycentrics = true;
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    out.f[0] = in.barycentric.x;
    out.f[1] = in.barycentric.y;
    out.f[2] = in.barycentric.z;
  }
};

}  // namespace voxelpipe
