#include "options/mesh_flags.h"

#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "options/request_flags.h"

namespace voxelpipe::cli {
namespace {

std::vector<std::string> FormatNames() {
  std::vector<std::string> names;
  for (const MeshFormat format :
       {MeshFormat::kAuto, MeshFormat::kGlb, MeshFormat::kGltf, MeshFormat::kDraco, MeshFormat::kStl, MeshFormat::kPly,
        MeshFormat::kOff, MeshFormat::kObj, MeshFormat::k3mf}) {
    names.emplace_back(Name(format));
  }
  return names;
}

const std::vector<std::string> kUnitNames = {"mm", "cm", "m", "in"};

}  // namespace

void AddMeshFlags(CLI::App& command, MeshFlags& flags) {
  command
      .add_option("--input-format", flags.input_format,
                  Wrapped("Format of the mesh file (default auto: by its content, then by its extension)"))
      ->type_name(absl::StrJoin(FormatNames(), "|"))
      ->check(CLI::IsMember(FormatNames()));
  command
      .add_option("--unit", flags.unit,
                  Wrapped("Unit of the positions in a file whose format has none (stl, ply, off, obj, drc), which are "
                          "then scaled to metres; without it they are taken as they are"))
      ->type_name(absl::StrJoin(kUnitNames, "|"))
      ->check(CLI::IsMember(kUnitNames));
  command.add_flag("--allow-outside", flags.allow_outside,
                   Wrapped("Also read files that a glTF or OBJ file names outside its directory, by .. or through a "
                           "link; otherwise they are refused"));
}

absl::StatusOr<MeshFileType> MeshTypeOf(const std::string& input_format, const std::string& unit) {
  MeshFileType type;
  if (input_format != Name(MeshFormat::kAuto)) {
    const std::optional<MeshFormat> format = MeshFormatOfName(absl::StrCat(".", input_format));
    if (!format) {
      return absl::InvalidArgumentError(
          absl::StrCat("input_format '", input_format, "' is none of ", absl::StrJoin(FormatNames(), ", ")));
    }
    type.format = *format;
  }
  if (!unit.empty()) {
    const std::optional<LengthUnit> known = LengthUnitOf(unit);
    if (!known) {
      return absl::InvalidArgumentError(absl::StrCat("unit '", unit, "' is none of ", absl::StrJoin(kUnitNames, ", ")));
    }
    type.unit = *known;
  }
  return type;
}

}  // namespace voxelpipe::cli
