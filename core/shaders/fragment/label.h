// label: the label of the triangle's part.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Output: u32, 1 component: the label of the part (mesh/parts/part_list.h) that the triangle belongs to; 1 where the
// request does not cut the mesh into parts.
struct LabelShader : FragmentShaderTraits {
  static constexpr bool kNeedsPlane = false;
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput&) { return true; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    out.u[0] = in.part->label;
  }
};

}  // namespace voxelpipe
