// metallic_roughness: how metallic and how rough the material is.
//
// Source: glTF 2.0 specification, section 3.9.2 (metallic-roughness material).
#pragma once

#include "shaders/fragment/material.h"

namespace voxelpipe {

// Output: f32, 2 components: metallic (factor x the texture's blue channel) and roughness (factor x green), both 0 to
// 1; the default material has 1, 1. Alpha mode MASK discards as in base_color.
struct MetallicRoughnessShader : FragmentShaderTraits {
  static constexpr bool kNeedsBarycentrics = true;
  static constexpr bool kCanDiscard = true, kIsColor = true;
  static constexpr bool kReadsMetallicRoughness = true;
  VOXELPIPE_HD static bool MayDiscard(const MaterialView& material) { return material.alpha_mask; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    const MaterialView& material = in.material();
    const Vec4f texel = SampleMaterial(in, material.metallic_roughness);
    out.f[0] = material.metallic_factor * texel.z;
    out.f[1] = material.roughness_factor * texel.y;
    out.discard = IsMasked(in);
  }
};

}  // namespace voxelpipe
