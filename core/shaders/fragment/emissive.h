// emissive: the light that the material emits.
//
// Source: glTF 2.0 specification, section 3.9.3 (additional textures); KHR_materials_emissive_strength.
#pragma once

#include "shaders/fragment/material.h"

namespace voxelpipe {

// Output: f32, 3 components, linear RGB: factor x strength x texture; above 1 with a strength above 1, 0 for the
// default material. Alpha mode MASK discards as in base_color.
struct EmissiveShader : FragmentShaderTraits {
  static constexpr bool kNeedsBarycentrics = true;
  static constexpr bool kCanDiscard = true, kIsColor = true;
  static constexpr bool kReadsEmissive = true;
  VOXELPIPE_HD static bool MayDiscard(const MaterialView& material) { return material.alpha_mask; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    const MaterialView& material = in.material();
    const Vec4f texel = SampleMaterial(in, material.emissive);
    for (int i = 0; i < 3; ++i) out.f[i] = material.emissive_factor[i] * texel[i];
    out.discard = IsMasked(in);
  }
};

}  // namespace voxelpipe
