#include "options/mesh_type.h"

#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace voxelpipe::cli {

std::vector<std::string> MeshFormatNames() {
  std::vector<std::string> names;
  for (const MeshFormat format :
       {MeshFormat::kAuto, MeshFormat::kGlb, MeshFormat::kGltf, MeshFormat::kDraco, MeshFormat::kStl, MeshFormat::kPly,
        MeshFormat::kOff, MeshFormat::kObj, MeshFormat::k3mf}) {
    names.emplace_back(Name(format));
  }
  return names;
}

std::vector<std::string> UnitNames() {
  return {"mm", "cm", "m", "in"};
}

absl::StatusOr<MeshFileType> MeshTypeOf(const std::string& input_format, const std::string& unit) {
  MeshFileType type;
  if (input_format != Name(MeshFormat::kAuto)) {
    const std::optional<MeshFormat> format = MeshFormatOfName(absl::StrCat(".", input_format));
    if (!format) {
      return absl::InvalidArgumentError(
          absl::StrCat("input_format '", input_format, "' is none of ", absl::StrJoin(MeshFormatNames(), ", ")));
    }
    type.format = *format;
  }
  if (!unit.empty()) {
    const std::optional<LengthUnit> known = LengthUnitOf(unit);
    if (!known) {
      return absl::InvalidArgumentError(
          absl::StrCat("unit '", unit, "' is none of ", absl::StrJoin(UnitNames(), ", ")));
    }
    type.unit = *known;
  }
  return type;
}

}  // namespace voxelpipe::cli
