// Source: Khronos Group, glTF extension registry (extensions/README.md).
#include "load/gltf/document/gltf_extensions.h"

#include <algorithm>

namespace voxelpipe::gltf {
namespace {

struct Row {
  std::string_view name;  // a trailing * matches any suffix
  ExtensionSupport support;
};

constexpr ExtensionSupport kRead = ExtensionSupport::kRead, kIgnored = ExtensionSupport::kIgnored;

// The first matching row counts.
constexpr Row kTable[] = {
    // Geometry
    {"KHR_draco_mesh_compression", kRead},
    {"EXT_meshopt_compression", kRead},
    {"KHR_meshopt_compression", kRead},
    {"KHR_mesh_quantization", kRead},
    {"KHR_accessor_float64", kRead},
    {"EXT_mesh_gpu_instancing", kRead},
    {"KHR_node_visibility", kRead},
    {"CESIUM_RTC", kRead},
    // Textures; a format that is not decoded has a warning of its own, if a shader reads the texture.
    {"KHR_texture_transform", kRead},
    {"EXT_texture_webp", kRead},
    {"KHR_texture_basisu", kRead},
    {"EXT_texture_avif", kRead},
    {"MSFT_texture_dds", kIgnored},
    // Materials: the base colour, metallic-roughness and emissive parts that shaders read
    {"KHR_materials_emissive_strength", kRead},
    {"KHR_materials_pbrSpecularGlossiness", kRead},
    {"KHR_materials_*", kIgnored},
    {"ADOBE_materials_*", kIgnored},
    // Lights, sounds, physics, behaviour
    {"KHR_lights_*", kIgnored},
    {"EXT_lights_*", kIgnored},
    {"KHR_audio*", kIgnored},
    {"OMI_*", kIgnored},
    {"KHR_physics*", kIgnored},
    {"KHR_implicit_shapes", kIgnored},
    {"KHR_rigid_bodies", kIgnored},
    {"MSFT_physics*", kIgnored},
    {"KHR_interactivity*", kIgnored},
    {"KHR_node_hoverability", kIgnored},
    {"KHR_node_selectability", kIgnored},
    {"KHR_animation_pointer", kIgnored},
    {"AGI_*", kIgnored},
    // Avatars, and variants that viewers choose from
    {"VRM*", kIgnored},
    {"MSFT_lod", kIgnored},
    {"KHR_xmp*", kIgnored},
    // Data besides the triangles
    {"EXT_mesh_features", kIgnored},
    {"EXT_instance_features", kIgnored},
    {"EXT_structural_metadata", kIgnored},
    {"EXT_feature_metadata", kIgnored},
    {"EXT_mesh_manifold", kIgnored},
    {"EXT_mesh_primitive_edge_visibility", kIgnored},
    {"CESIUM_primitive_outline", kIgnored},
    {"BENTLEY_materials_*", kIgnored},
    {"KHR_gaussian_splatting*", kIgnored},
    {"EXT_primitive_voxels", kIgnored},
    {"FB_geometry_metadata", kIgnored},
    {"GRIFFEL_bim_data", kIgnored},
};

bool Fits(std::string_view pattern, std::string_view name) {
  if (!pattern.ends_with('*')) return name == pattern;
  return name.starts_with(pattern.substr(0, pattern.size() - 1));
}

}  // namespace

ExtensionSupport SupportOf(std::string_view extension) {
  const auto* const row =
      std::find_if(std::begin(kTable), std::end(kTable), [&](const Row& r) { return Fits(r.name, extension); });
  return row == std::end(kTable) ? ExtensionSupport::kRefused : row->support;
}

}  // namespace voxelpipe::gltf
