#include "load/gltf_attributes.h"

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe::gltf {

absl::StatusOr<std::optional<AttributeValues>> AttributeSource::Find(const std::string& name) {
  if (const auto id = draco_ids_.find(name); draco_ && id != draco_ids_.end()) {
    for (DracoAttribute& attribute : draco_->attributes) {
      if (attribute.unique_id != id->second) continue;
      return AttributeValues{attribute.components, attribute.values, absl::StrCat("Draco attribute ", id->second)};
    }
    return absl::InvalidArgumentError(
        absl::StrCat(name, " names the Draco attribute ", id->second, ", which the stream does not have"));
  }
  const auto it = accessors_.find(name);
  if (it == accessors_.end()) return std::nullopt;
  const uint32_t accessor = static_cast<uint32_t>(it->second);
  const AccessorDecl& decl = context_.accessors.decl(accessor);
  absl::StatusOr<std::vector<float>> values = context_.accessors.Floats(accessor);
  if (!values.ok()) return values.status();
  return AttributeValues{decl.matrix ? 0 : decl.components, *std::move(values), absl::StrCat("accessor ", accessor)};
}

}  // namespace voxelpipe::gltf
