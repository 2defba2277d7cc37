// uv: texture coordinates.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Parameter set: 0 or 1 (TEXCOORD_0, TEXCOORD_1). Output: f32, 2 components, as in the file: origin at the image's top
// left, not wrapped, no KHR_texture_transform. 0, 0 where the mesh has none of that set.
struct UvShader : FragmentShaderTraits {
  static constexpr bool kIsFraction = true;
  static constexpr bool kNeedsBarycentrics = true;
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams& params, FragmentOutput& out) {
    const int set = params.value[0] == 1 ? 1 : 0;
    if (!in.part->has_uv[set]) return;
    const Vec2f* uv = in.mesh->uv[set];
    const Vec2f at = Interpolate(in.barycentric, uv[in.vertex[0]], uv[in.vertex[1]], uv[in.vertex[2]]);
    out.f[0] = at.x;
    out.f[1] = at.y;
  }
};

}  // namespace voxelpipe
