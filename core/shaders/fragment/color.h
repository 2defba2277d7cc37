// color: vertex colours.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Output: f32, 4 components: COLOR_0, linear RGBA, alpha 1 where the file has RGB; white where the mesh has none. Reads
// no material: alpha MASK does not apply.
struct ColorShader : FragmentShaderTraits {
  static constexpr bool kNeedsBarycentrics = true;
  static constexpr bool kIsColor = true;
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput& in) { return !in.part->has_colors; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    Vec4f color{1, 1, 1, 1};
    if (in.part->has_colors) {
      const Vec4f* c = in.mesh->colors;
      color = Interpolate(in.barycentric, c[in.vertex[0]], c[in.vertex[1]], c[in.vertex[2]]);
    }
    for (int i = 0; i < 4; ++i) out.f[i] = color[i];
  }
};

}  // namespace voxelpipe
