// occupancy: 1 for every fragment.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Output: f32, 1 component.
struct OccupancyShader : FragmentShaderTraits {
  static constexpr bool kNeedsPlane = false;
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput&) { return true; }
  VOXELPIPE_HD static void Shade(const FragmentInput&, const ShaderParams&, FragmentOutput& out) { out.f[0] = 1; }
};

}  // namespace voxelpipe
