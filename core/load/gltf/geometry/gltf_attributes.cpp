#include "load/gltf/geometry/gltf_attributes.h"

#include <algorithm>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe::gltf {

std::vector<std::string> AttributeSource::OwnNames() const {
  std::vector<std::string> names;
  for (const auto& [name, accessor] : accessors_) {
    if (name[0] == '_') names.push_back(name);
  }
  return names;
}

bool AttributeSource::IsNormalized(const std::string& name, const DracoAttribute& attribute) const {
  // Encoders rarely store the accessor's `normalized` in the stream; in glTF integer colours are always normalized.
  constexpr int kFloat = 5126;
  const auto accessor = accessors_.find(name);
  if (accessor == accessors_.end() || attribute.kind == DracoAttribute::Kind::kColor) return attribute.normalized;
  const AccessorDecl& decl = context_.accessors.decl(static_cast<uint32_t>(accessor->second));
  return decl.component_type == kFloat ? attribute.normalized : decl.normalized;
}

absl::StatusOr<const DracoAttribute*> AttributeSource::InDraco(const std::string& name) {
  const auto id = draco_ids_.find(name);
  if (!draco_ || id == draco_ids_.end()) return nullptr;
  if (const auto place = draco_places_.find(id->second); place != draco_places_.end()) {
    DracoAttribute& attribute = draco_->attributes[place->second];
    if (IsNormalized(name, attribute) && normalized_.insert(attribute.unique_id).second) Normalize(attribute);
    return &attribute;
  }
  return absl::InvalidArgumentError(
      absl::StrCat(name, " names the Draco attribute ", id->second, ", which the stream does not have"));
}

absl::StatusOr<std::optional<AttributeValues>> AttributeSource::Find(const std::string& name) {
  const absl::StatusOr<const DracoAttribute*> draco = InDraco(name);
  if (!draco.ok()) return draco.status();
  if (const DracoAttribute* const attribute = *draco) {
    const uint64_t values = attribute->values.size();
    if (absl::Status full = context_.budget.Take(values, sizeof(float), name); !full.ok()) return full;
    return AttributeValues{attribute->components, attribute->values,
                           absl::StrCat("Draco attribute ", attribute->unique_id)};
  }
  const auto it = accessors_.find(name);
  if (it == accessors_.end()) return std::nullopt;
  const uint32_t accessor = static_cast<uint32_t>(it->second);
  const AccessorDecl& decl = context_.accessors.decl(accessor);
  absl::StatusOr<std::vector<float>> values = context_.accessors.Floats(accessor);
  if (!values.ok()) return values.status();
  return AttributeValues{decl.matrix ? 0 : decl.components, *std::move(values), absl::StrCat("accessor ", accessor)};
}

absl::StatusOr<std::vector<Vec3d>> AttributeSource::DoublePositions() const {
  const auto it = accessors_.find("POSITION");
  if (draco_ || it == accessors_.end()) return std::vector<Vec3d>();
  const auto accessor = static_cast<uint32_t>(it->second);
  if (context_.accessors.decl(accessor).component_type != kDoubleComponents) return std::vector<Vec3d>();
  return context_.accessors.Doubles(accessor);
}

template <typename V>
absl::StatusOr<std::optional<AttributeVectors<V>>> AttributeSource::FindVectors(const std::string& name) {
  constexpr int kComponents = sizeof(V) / sizeof(float);
  const absl::StatusOr<const DracoAttribute*> draco = InDraco(name);
  if (!draco.ok()) return draco.status();
  const auto it = accessors_.find(name);
  if (*draco == nullptr && it != accessors_.end()) {
    const uint32_t accessor = static_cast<uint32_t>(it->second);
    const AccessorDecl& decl = context_.accessors.decl(accessor);
    if (!decl.matrix && decl.components == kComponents) {
      absl::StatusOr<std::vector<V>> values = context_.accessors.Vectors<V>(accessor);
      if (!values.ok()) return values.status();
      return AttributeVectors<V>{kComponents, *std::move(values), absl::StrCat("accessor ", accessor)};
    }
  }
  const absl::StatusOr<std::optional<AttributeValues>> found = Find(name);
  if (!found.ok()) return found.status();
  if (!*found) return std::nullopt;
  const AttributeValues& data = **found;
  AttributeVectors<V> out{data.components, {}, data.origin};
  if (data.components == kComponents) {
    if (absl::Status full = context_.budget.Take(data.values.size(), sizeof(float), name); !full.ok()) return full;
    out.values.resize(data.values.size() / kComponents);
    std::copy(data.values.begin(), data.values.end(), reinterpret_cast<float*>(out.values.data()));
  }
  return out;
}
template absl::StatusOr<std::optional<AttributeVectors<Vec2f>>> AttributeSource::FindVectors(const std::string&);
template absl::StatusOr<std::optional<AttributeVectors<Vec3f>>> AttributeSource::FindVectors(const std::string&);
template absl::StatusOr<std::optional<AttributeVectors<Vec4f>>> AttributeSource::FindVectors(const std::string&);

}  // namespace voxelpipe::gltf
