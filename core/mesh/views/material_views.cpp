// Source: KHR_texture_transform.
#include "mesh/views/material_views.h"

#include <cmath>

#include "mesh/views/mips.h"

namespace voxelpipe {
namespace {

TextureView ViewOf(const Texture& texture, const TriangleMesh& mesh, bool srgb) {
  TextureView view;
  view.wrap_s = uint8_t(texture.wrap_s);
  view.wrap_t = uint8_t(texture.wrap_t);
  view.mip_filter = uint8_t(texture.mip_filter);
  view.nearest = texture.nearest;
  view.min_nearest = texture.min_nearest;
  view.srgb = srgb;
  if (texture.image < 0 || size_t(texture.image) >= mesh.images.size() || mesh.images[texture.image] == nullptr)
    return view;
  const Image& image = *mesh.images[texture.image];
  if (image.rgba.empty()) return view;
  view.rgba = image.rgba.data();
  view.width = image.width;
  view.height = image.height;
  const std::vector<Vec4f>& mips = srgb ? image.srgb_mips : image.linear_mips;
  if (!mips.empty()) {
    view.mips = mips.data();
    view.levels = CountLevels(image.width, image.height);
  }
  return view;
}

TextureRefView ViewOf(const TextureRef& ref, bool srgb, const std::vector<TextureView>& textures) {
  TextureRefView view;
  if (ref.texture < 0 || size_t(ref.texture) >= textures.size() / 2) return view;
  view.texture = 2 * ref.texture + (srgb ? 1 : 0);
  view.uv_set = ref.uv_set == 1 ? 1 : 0;
  // offset + rotation * scale, the rotation counter-clockwise with v pointing down.
  const double c = std::cos(double(ref.rotation)), s = std::sin(double(ref.rotation));
  view.m[0][0] = float(c * ref.scale[0]);
  view.m[0][1] = float(s * ref.scale[1]);
  view.m[0][2] = ref.offset[0];
  view.m[1][0] = float(-s * ref.scale[0]);
  view.m[1][1] = float(c * ref.scale[1]);
  view.m[1][2] = ref.offset[1];
  const TextureView& texture = textures[size_t(view.texture)];
  const double scaled = std::abs(double(ref.scale[0]) * double(ref.scale[1]));
  view.texels = float(std::sqrt(scaled * double(texture.width) * double(texture.height)));
  return view;
}

}  // namespace

MaterialViews MakeMaterialViews(const TriangleMesh& mesh) {
  MaterialViews views;
  for (const Texture& texture : mesh.textures) {
    for (const bool srgb : {false, true}) views.textures.push_back(ViewOf(texture, mesh, srgb));
  }
  for (const Material& material : mesh.materials) {
    MaterialView view;
    view.base_color_factor = material.base_color_factor;
    view.base_color = ViewOf(material.base_color, true, views.textures);
    view.emissive_factor = material.emissive_factor * material.emissive_strength;
    view.emissive = ViewOf(material.emissive, true, views.textures);
    view.metallic_factor = material.metallic_factor;
    view.roughness_factor = material.roughness_factor;
    view.metallic_roughness = ViewOf(material.metallic_roughness, false, views.textures);
    view.alpha_mask = material.alpha_mode == AlphaMode::kMask;
    view.alpha_cutoff = material.alpha_cutoff;
    views.materials.push_back(view);
  }
  views.materials.push_back(MaterialView{});
  return views;
}

}  // namespace voxelpipe
