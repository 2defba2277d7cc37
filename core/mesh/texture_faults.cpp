#include "mesh/texture_faults.h"

#include <set>
#include <utility>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr TextureUse kAllTextures{true, true, true};

// Calls see(name, reference) for the textures of a material that are in `use`.
template <typename See>
void ForEachTexture(const Material& material, const TextureUse& use, const See& see) {
  if (use.base_color) see("base colour", material.base_color);
  if (use.emissive) see("emissive", material.emissive);
  if (use.metallic_roughness) see("metallic-roughness", material.metallic_roughness);
}

void AddReferenceWarnings(const TriangleMesh& mesh, size_t index, const TextureUse& use, WarningList& warnings) {
  ForEachTexture(mesh.materials[index], use, [&](const char* name, const TextureRef& ref) {
    if (!ref.fault.empty()) {
      warnings.Add(WarningCode::kTextureMissing, absl::StrCat("material ", index),
                   absl::StrCat(name, " texture: ", ref.fault, "; the material's factor is used"));
    }
    if (ref.texture < 0 || size_t(ref.texture) >= mesh.textures.size()) return;
    const Texture& texture = mesh.textures[size_t(ref.texture)];
    if (texture.image < 0 || size_t(texture.image) >= mesh.images.size() || mesh.images[texture.image] == nullptr) {
      warnings.Add(WarningCode::kTextureMissing, absl::StrCat("texture ", ref.texture),
                   "names no image; the material's factor is used");
    } else if (const std::optional<Warning>& fault = mesh.images[size_t(texture.image)]->fault) {
      warnings.Add(fault->code, fault->place, fault->text);
    }
  });
}

// Warns of parts whose material has a texture for which they have no coordinates. Once for all instances of a
// primitive: there may be ten million.
void AddCoordinateWarnings(const TriangleMesh& mesh, const TextureUse& use, WarningList& warnings) {
  std::set<std::pair<uint32_t, uint32_t>> seen;
  for (const MeshPart& part : mesh.parts) {
    if (part.triangle_count == 0 || part.material < 0 || size_t(part.material) >= mesh.materials.size()) continue;
    if (part.has_uv[0] && part.has_uv[1]) continue;
    if (!seen.insert({part.mesh, part.primitive}).second) continue;
    const Material& material = mesh.materials[size_t(part.material)];
    ForEachTexture(material, TexturesOf(material, use), [&](const char* name, const TextureRef& ref) {
      if (ref.texture < 0 || part.has_uv[ref.uv_set == 1 ? 1 : 0]) return;
      warnings.Add(WarningCode::kTextureMissing, absl::StrCat("mesh ", part.mesh, ", primitive ", part.primitive),
                   absl::StrCat("no TEXCOORD_", ref.uv_set, " for the ", name, " texture of material ", part.material,
                                "; the material's factor is used"));
    });
  }
}

}  // namespace

std::vector<bool> MaterialsInUse(const TriangleMesh& mesh) {
  std::vector<bool> used(mesh.materials.size());
  for (const MeshPart& part : mesh.parts) {
    if (part.triangle_count > 0 && part.material >= 0 && size_t(part.material) < used.size()) {
      used[size_t(part.material)] = true;
    }
  }
  return used;
}

TextureUse TexturesOf(const Material& material, const TextureUse& use) {
  TextureUse read = use;
  read.base_color = use.base_color || (use.any() && material.alpha_mode == AlphaMode::kMask);
  return read;
}

void AddTextureWarnings(const TriangleMesh& mesh, const TextureUse& use, WarningList& warnings) {
  if (!use.any()) return;
  const std::vector<bool> used = MaterialsInUse(mesh);
  for (size_t i = 0; i < used.size(); ++i) {
    if (used[i]) AddReferenceWarnings(mesh, i, TexturesOf(mesh.materials[i], use), warnings);
  }
  AddCoordinateWarnings(mesh, use, warnings);
}

void AddAllTextureWarnings(const TriangleMesh& mesh, WarningList& warnings) {
  for (const std::shared_ptr<Image>& image : mesh.images) {
    if (image != nullptr && image->fault) warnings.Add(image->fault->code, image->fault->place, image->fault->text);
  }
  for (size_t i = 0; i < mesh.materials.size(); ++i) AddReferenceWarnings(mesh, i, kAllTextures, warnings);
  AddCoordinateWarnings(mesh, kAllTextures, warnings);
}

}  // namespace voxelpipe
