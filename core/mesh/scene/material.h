// Materials, textures and images for the fragment shaders.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/memory_budget.h"
#include "base/vec.h"
#include "base/warning.h"

namespace voxelpipe {

enum class AlphaMode : uint8_t { kOpaque, kMask, kBlend };
enum class WrapMode : uint8_t { kRepeat, kMirroredRepeat, kClampToEdge };
// The levels of a texture that are sampled where its texels are smaller than voxels.
enum class MipFilter : uint8_t {
  kNone,     // level 0 alone
  kNearest,  // the level nearest to one texel a voxel
  kLinear,   // the two levels around that, interpolated
};

// A reference from a material to a texture, with KHR_texture_transform: uv' = offset + R(rotation) * (scale * uv).
struct TextureRef {
  int32_t texture = -1;  // index into textures, -1 = none
  int32_t uv_set = 0;    // 0 or 1
  float offset[2] = {0, 0};
  float scale[2] = {1, 1};
  float rotation = 0;  // radians, counter-clockwise as the extension defines it
  std::string
      fault{};  // why the file's reference cannot be used (then texture is -1); empty if it can, or there is none
};

struct Material {
  std::string name;
  Vec4f base_color_factor{1, 1, 1, 1};  // linear
  TextureRef base_color;                // sRGB texels
  Vec3f emissive_factor{0, 0, 0};
  float emissive_strength = 1;  // KHR_materials_emissive_strength
  TextureRef emissive;          // sRGB texels
  float metallic_factor = 1, roughness_factor = 1;
  TextureRef metallic_roughness;  // G = roughness, B = metallic
  AlphaMode alpha_mode = AlphaMode::kOpaque;
  float alpha_cutoff = 0.5f;
  bool double_sided = false;
};

struct Texture {
  int32_t image = -1;  // index into images, -1 = none in the file (only the factor is used)
  WrapMode wrap_s = WrapMode::kRepeat, wrap_t = WrapMode::kRepeat;
  // Filters within a level, nearest or bilinear: up to one texel a voxel, and beyond.
  bool nearest = false, min_nearest = false;
  MipFilter mip_filter = MipFilter::kLinear;
};

// An image keeps its encoded bytes until a shader needs its texels (load/decode/image.h decodes).
struct Image {
  std::string name;
  std::string mime_type;           // "image/png", "image/jpeg", or what the file says
  std::vector<uint8_t> encoded;    // owned copy of the file's bytes
  uint32_t width = 0, height = 0;  // texels; 0 until decoded
  std::vector<uint8_t> rgba;       // 4 bytes a texel, rows from the top; empty until decoded
  // Smaller levels (load/decode/mips.h) of the texels, once as linear values and once as sRGB colours; empty until a
  // shader samples them.
  std::vector<Vec4f> linear_mips, srgb_mips;
  // Why it has no texels: it has no bytes, or a format that is not decoded. Materials then have no texture.
  std::optional<Warning> fault{};
  // The charge for its bytes to the budget of the request that loaded it; null: not charged.
  std::shared_ptr<MemoryCharge> memory{};
};

// The textures of the materials that shaders sample.
struct TextureUse {
  bool base_color = false, emissive = false, metallic_roughness = false;
  bool any() const { return base_color || emissive || metallic_roughness; }
};

}  // namespace voxelpipe
