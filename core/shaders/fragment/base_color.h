// base_color: the material's base colour, linear RGBA: factor x texture x vertex colour.
#pragma once

#include "shaders/fragment/material.h"

namespace voxelpipe {

// Output: f32, 4 components, linear; what the mesh lacks counts as white. Alpha mode MASK discards a fragment whose
// alpha is below the cutoff.
struct BaseColorShader : FragmentShaderTraits {
  static constexpr bool kNeedsBarycentrics = true;
  static constexpr bool kCanDiscard = true, kIsColor = true;
  static constexpr bool kReadsBaseColor = true;
  VOXELPIPE_HD static bool MayDiscard(const MaterialView& material) { return material.alpha_mask; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    const Vec4f color = BaseColor(in);
    for (int i = 0; i < 4; ++i) out.f[i] = color[i];
    out.discard = in.material().alpha_mask && color.w < in.material().alpha_cutoff;
  }
};

}  // namespace voxelpipe
