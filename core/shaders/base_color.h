// base_color: the material's base colour, linear RGBA: factor x texture x vertex colour.
//
// Source: glTF 2.0 specification, section 3.9.2 (metallic-roughness material), 3.9.4 (alpha coverage).
#pragma once

#include "shaders/fragment.h"
#include "shaders/texture.h"

namespace voxelpipe {

// Output: f32, 4 components, linear. Alpha mode MASK discards a fragment whose alpha is below the cutoff.
struct BaseColorShader : FragmentShaderTraits {
  static constexpr bool kNeedsBarycentrics = true;
  static constexpr bool kCanDiscard = true, kIsColor = true;
  static constexpr bool kReadsBaseColor = true;
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    const MaterialView& material = in.material();
    Vec4f color = material.base_color_factor;
    const TextureRefView& ref = material.base_color;
    const Vec2f* uv = in.mesh->uv[ref.uv_set];
    if (ref.texture >= 0 && in.part->has_uv[ref.uv_set]) {
      const Vec2f at = Interpolate(in.barycentric, uv[in.vertex[0]], uv[in.vertex[1]], uv[in.vertex[2]]);
      const Vec2f moved{(ref.m[0][0] * at.x + ref.m[0][1] * at.y) + ref.m[0][2],
                        (ref.m[1][0] * at.x + ref.m[1][1] * at.y) + ref.m[1][2]};
      Multiply(color, SampleSrgb(in.mesh->textures[ref.texture], moved));
    }
    if (in.part->has_colors) {
      const Vec4f* c = in.mesh->colors;
      Multiply(color, Interpolate(in.barycentric, c[in.vertex[0]], c[in.vertex[1]], c[in.vertex[2]]));
    }
    for (int i = 0; i < 4; ++i) out.f[i] = color[i];
    out.discard = material.alpha_mask && color.w < material.alpha_cutoff;
  }

 private:
  VOXELPIPE_HD static void Multiply(Vec4f& a, const Vec4f& b) { a = {a.x * b.x, a.y * b.y, a.z * b.z, a.w * b.w}; }
};

}  // namespace voxelpipe
