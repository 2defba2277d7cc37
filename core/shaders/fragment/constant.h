// constant: the same value for every fragment.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Parameter value (1-4 numbers). Output: f32, 4 components, those not given 0, the fourth 1.
struct ConstantShader : FragmentShaderTraits {
  static constexpr bool kNeedsPlane = false;
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput&) { return true; }
  VOXELPIPE_HD static void Shade(const FragmentInput&, const ShaderParams& params, FragmentOutput& out) {
    for (int i = 0; i < 4; ++i) out.f[i] = float(params.value[i]);
  }
};

}  // namespace voxelpipe
