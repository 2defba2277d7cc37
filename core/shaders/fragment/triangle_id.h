// triangle_id: the id of the triangle, from 0 over the flattened scene.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Output: u32, 1 component.
struct TriangleIdShader : FragmentShaderTraits {
  static constexpr bool kNeedsPlane = false;
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput&) { return true; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    out.u[0] = in.triangle;
  }
};

}  // namespace voxelpipe
