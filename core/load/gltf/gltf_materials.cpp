#include "load/gltf/gltf_materials.h"

#include <cmath>
#include <map>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "load/base/data_uri.h"
#include "load/gltf/document/gltf_model.h"
#include "load/gltf/document/json_guard.h"

namespace voxelpipe::gltf {
namespace {

constexpr int kNearest = 9728, kLinear = 9729;
constexpr int kNearestMipmapNearest = 9984, kLinearMipmapNearest = 9985, kNearestMipmapLinear = 9986;
constexpr int kClampToEdge = 33071, kMirroredRepeat = 33648;

float ToFloat(double value, float fallback) {
  const float narrow = static_cast<float>(value);
  return std::isfinite(narrow) ? narrow : fallback;
}

float NumberAt(const tinygltf::Value& array, size_t index, float fallback) {
  if (!array.IsArray() || index >= array.ArrayLen()) return fallback;
  const tinygltf::Value& value = array.Get(static_cast<int>(index));
  return value.IsNumber() ? ToFloat(value.GetNumberAsDouble(), fallback) : fallback;
}

// KHR_texture_transform; its texCoord overrides the texture info's.
void ReadTransform(const tinygltf::Value& extension, TextureRef& out) {
  for (size_t i = 0; i < 2; ++i) {
    out.offset[i] = NumberAt(extension.Get("offset"), i, 0.0f);
    out.scale[i] = NumberAt(extension.Get("scale"), i, 1.0f);
  }
  const tinygltf::Value& rotation = extension.Get("rotation");
  if (rotation.IsNumber()) out.rotation = ToFloat(rotation.GetNumberAsDouble(), 0.0f);
  const tinygltf::Value& uv_set = extension.Get("texCoord");
  if (uv_set.IsNumber()) out.uv_set = uv_set.GetNumberAsInt();
}

class MaterialReader {
 public:
  explicit MaterialReader(const tinygltf::Model& model) : model_(model) {}

  Material Read(const tinygltf::Material& from) {
    Material out;
    out.name = from.name;
    const tinygltf::PbrMetallicRoughness& pbr = from.pbrMetallicRoughness;
    for (int c = 0; c < 4 && pbr.baseColorFactor.size() == 4; ++c) {
      out.base_color_factor[c] = ToFloat(pbr.baseColorFactor[c], 1.0f);
    }
    out.base_color =
        Reference(pbr.baseColorTexture.index, pbr.baseColorTexture.texCoord, pbr.baseColorTexture.extensions);
    out.metallic_factor = ToFloat(pbr.metallicFactor, 1.0f);
    out.roughness_factor = ToFloat(pbr.roughnessFactor, 1.0f);
    out.metallic_roughness = Reference(pbr.metallicRoughnessTexture.index, pbr.metallicRoughnessTexture.texCoord,
                                       pbr.metallicRoughnessTexture.extensions);
    for (int c = 0; c < 3 && from.emissiveFactor.size() == 3; ++c) {
      out.emissive_factor[c] = ToFloat(from.emissiveFactor[c], 0.0f);
    }
    out.emissive =
        Reference(from.emissiveTexture.index, from.emissiveTexture.texCoord, from.emissiveTexture.extensions);
    if (from.alphaMode == "MASK") out.alpha_mode = AlphaMode::kMask;
    if (from.alphaMode == "BLEND") out.alpha_mode = AlphaMode::kBlend;
    out.alpha_cutoff = ToFloat(from.alphaCutoff, 0.5f);
    out.double_sided = from.doubleSided;
    const auto strength = from.extensions.find("KHR_materials_emissive_strength");
    if (strength != from.extensions.end() && strength->second.Get("emissiveStrength").IsNumber()) {
      out.emissive_strength = ToFloat(strength->second.Get("emissiveStrength").GetNumberAsDouble(), 1.0f);
    }
    const auto gloss = from.extensions.find("KHR_materials_pbrSpecularGlossiness");
    if (gloss != from.extensions.end()) ReadDiffuse(gloss->second, out);
    return out;
  }

 private:
  TextureRef Reference(int texture, int uv_set, const tinygltf::ExtensionMap& extensions) {
    TextureRef out;
    if (texture == -1) return out;
    if (texture < 0 || static_cast<size_t>(texture) >= model_.textures.size()) {
      out.fault = absl::StrCat("texture ", texture, " does not exist");
      return out;
    }
    out.texture = texture;
    out.uv_set = uv_set;
    const auto transform = extensions.find("KHR_texture_transform");
    if (transform != extensions.end()) ReadTransform(transform->second, out);
    if (out.uv_set < 0 || out.uv_set > 1) {
      TextureRef unread;
      unread.fault = absl::StrCat("TEXCOORD_", out.uv_set, " is not read");
      return unread;
    }
    return out;
  }

  // The diffuse part of the older specular-glossiness model is used as base colour.
  void ReadDiffuse(const tinygltf::Value& extension, Material& out) {
    const tinygltf::Value& factor = extension.Get("diffuseFactor");
    for (int c = 0; c < 4; ++c) out.base_color_factor[c] = NumberAt(factor, static_cast<size_t>(c), 1.0f);
    out.base_color = TextureRef{};
    const tinygltf::Value& texture = extension.Get("diffuseTexture");
    if (!texture.IsObject() || !texture.Get("index").IsInt()) return;
    tinygltf::ExtensionMap extensions;
    if (texture.Get("extensions").Has("KHR_texture_transform")) {
      extensions["KHR_texture_transform"] = texture.Get("extensions").Get("KHR_texture_transform");
    }
    const int uv_set = texture.Get("texCoord").IsInt() ? texture.Get("texCoord").GetNumberAsInt() : 0;
    out.base_color = Reference(texture.Get("index").GetNumberAsInt(), uv_set, extensions);
  }

  const tinygltf::Model& model_;
};

WrapMode ToWrap(int wrap) {
  if (wrap == kClampToEdge) return WrapMode::kClampToEdge;
  return wrap == kMirroredRepeat ? WrapMode::kMirroredRepeat : WrapMode::kRepeat;
}

// True if a filter takes the nearest texel within a level.
bool IsNearest(int filter) {
  return filter == kNearest || filter == kNearestMipmapNearest || filter == kNearestMipmapLinear;
}

// The image of a texture: the core one, otherwise one of an extension, decoded formats first.
int SourceOf(const tinygltf::Texture& texture) {
  if (texture.source >= 0) return texture.source;
  for (const char* name : {"EXT_texture_webp", "KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds"}) {
    const auto extension = texture.extensions.find(name);
    if (extension == texture.extensions.end()) continue;
    const tinygltf::Value& source = extension->second.Get("source");
    if (source.IsInt()) return source.GetNumberAsInt();
  }
  return -1;
}

Texture ReadTexture(const tinygltf::Model& model, const tinygltf::Texture& from, const Scene& scene) {
  Texture out;
  const int source = SourceOf(from);
  if (source >= 0 && static_cast<size_t>(source) < scene.images.size()) out.image = source;
  if (from.sampler >= 0 && static_cast<size_t>(from.sampler) < model.samplers.size()) {
    const tinygltf::Sampler& sampler = model.samplers[from.sampler];
    out.wrap_s = ToWrap(sampler.wrapS);
    out.wrap_t = ToWrap(sampler.wrapT);
    // A missing filter takes the value of the other; levels are interpolated unless the minification filter says
    // otherwise.
    const int mag = sampler.magFilter > 0 ? sampler.magFilter : sampler.minFilter;
    const int min = sampler.minFilter > 0 ? sampler.minFilter : sampler.magFilter;
    out.nearest = IsNearest(mag);
    out.min_nearest = IsNearest(min);
    if (sampler.minFilter == kNearest || sampler.minFilter == kLinear) out.mip_filter = MipFilter::kNone;
    if (min == kNearestMipmapNearest || min == kLinearMipmapNearest) out.mip_filter = MipFilter::kNearest;
  }
  return out;
}

// The encoded bytes of an image; none and Image::fault if they are not inside the document.
absl::Status ReadImage(const ImageDecl& decl, size_t index, Buffers& buffers, Budget& budget, Image& out) {
  out.name = decl.name.empty() ? absl::StrCat("image ", index) : decl.name;
  out.mime_type = decl.mime_type;
  const std::string where = absl::StrCat("image ", index);
  const auto missing = [&](const std::string& what) {
    out.fault = Warning{WarningCode::kTextureMissing, where, absl::StrCat(what, "; the material's factor is used")};
    return absl::OkStatus();
  };
  if (decl.uri) {
    if (!IsDataUri(*decl.uri)) {
      return missing(absl::StrCat("the URI ", Quoted(*decl.uri), " leads to no file that could be read"));
    }
    MemoryCharge charge = budget.NewCharge();
    if (absl::Status full = budget.Take(decl.uri->size(), 2, where, charge); !full.ok()) return full;
    absl::StatusOr<DataUri> data = DecodeDataUri(budget.job(), *decl.uri);
    if (absl::IsInvalidArgument(data.status())) return missing(std::string(data.status().message()));
    if (!data.ok()) return data.status();
    if (out.mime_type.empty()) out.mime_type = data->media_type;
    out.encoded = std::move(data->bytes);
    charge.ShrinkTo(out.encoded.size());
    out.memory = std::make_shared<MemoryCharge>(std::move(charge));
    return absl::OkStatus();
  }
  if (decl.view < 0) return missing("neither uri nor bufferView");
  absl::StatusOr<std::span<const uint8_t>> bytes = buffers.View(static_cast<uint32_t>(decl.view), budget);
  if (absl::IsInvalidArgument(bytes.status())) return missing(std::string(bytes.status().message()));
  if (!bytes.ok()) return bytes.status();
  MemoryCharge charge = budget.NewCharge();
  if (absl::Status full = budget.Take(bytes->size(), 1, where, charge); !full.ok()) return full;
  out.encoded.assign(bytes->begin(), bytes->end());
  out.memory = std::make_shared<MemoryCharge>(std::move(charge));
  return absl::OkStatus();
}

}  // namespace

absl::Status ReadMaterials(const tinygltf::Model& model, const Document& document, Buffers& buffers, Budget& budget,
                           Scene& scene) {
  std::map<int64_t, size_t> first;  // image of a buffer view: images with the same bytes are decoded once
  for (size_t i = 0; i < document.images.size(); ++i) {
    const ImageDecl& decl = document.images[i];
    if (!decl.uri && decl.view >= 0) {
      const auto [known, fresh] = first.try_emplace(decl.view, i);
      if (!fresh) {
        scene.images.push_back(scene.images[known->second]);
        continue;
      }
    }
    if (absl::Status full = budget.Take(sizeof(Image) + decl.name.size() + decl.mime_type.size(), 1, "images");
        !full.ok()) {
      return full;
    }
    auto image = std::make_shared<Image>();
    if (absl::Status bad = ReadImage(decl, i, buffers, budget, *image); !bad.ok()) return bad;
    scene.images.push_back(std::move(image));
  }
  for (const tinygltf::Texture& texture : model.textures) scene.textures.push_back(ReadTexture(model, texture, scene));
  const uint64_t bytes = model.materials.size() * sizeof(Material) + model.textures.size() * sizeof(Texture);
  if (absl::Status full = budget.Take(bytes, 1, "materials"); !full.ok()) return full;
  MaterialReader reader(model);
  for (const tinygltf::Material& material : model.materials) scene.materials.push_back(reader.Read(material));
  return absl::OkStatus();
}

}  // namespace voxelpipe::gltf
