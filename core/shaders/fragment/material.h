// The material at a fragment: its textures sampled, its alpha mask.
//
// Source: glTF 2.0 specification, sections 3.9.2 (metallic-roughness material), 3.9.4 (alpha coverage);
// KHR_texture_transform.
#pragma once

#include "shaders/interface/fragment.h"
#include "shaders/texture/texture.h"

namespace voxelpipe {

// Linear RGBA of a material's texture; white where the material has none, or the mesh no such texture coordinates.
VOXELPIPE_HD_CALL Vec4f SampleMaterial(const FragmentInput& in, const TextureRefView& ref) {
  if (ref.texture < 0 || !in.part->has_uv[ref.uv_set]) return {1, 1, 1, 1};
  const Vec2f* uv = in.mesh->uv[ref.uv_set];
  const Vec2f at = Interpolate(in.barycentric, uv[in.vertex[0]], uv[in.vertex[1]], uv[in.vertex[2]]);
  const Vec2f moved{(ref.m[0][0] * at.x + ref.m[0][1] * at.y) + ref.m[0][2],
                    (ref.m[1][0] * at.x + ref.m[1][1] * at.y) + ref.m[1][2]};
  return SampleTexture(in.mesh->textures[ref.texture], moved, in.uv_density[ref.uv_set] * ref.texels);
}

VOXELPIPE_HD Vec4f Times(const Vec4f& a, const Vec4f& b) {
  return {a.x * b.x, a.y * b.y, a.z * b.z, a.w * b.w};
}

// Base colour: factor x texture x vertex colour, linear RGBA.
VOXELPIPE_HD Vec4f BaseColor(const FragmentInput& in) {
  const MaterialView& material = in.material();
  Vec4f color = Times(material.base_color_factor, SampleMaterial(in, material.base_color));
  if (!in.part->has_colors) return color;
  const Vec4f* c = in.mesh->colors;
  return Times(color, Interpolate(in.barycentric, c[in.vertex[0]], c[in.vertex[1]], c[in.vertex[2]]));
}

// True if alpha mode MASK discards the fragment: the base colour's alpha is below the cutoff.
VOXELPIPE_HD bool IsMasked(const FragmentInput& in) {
  const MaterialView& material = in.material();
  return material.alpha_mask && BaseColor(in).w < material.alpha_cutoff;
}

}  // namespace voxelpipe
