#include "options/mesh_flags.h"

#include "absl/strings/str_join.h"
#include "options/request_flags.h"

namespace voxelpipe::cli {

void AddMeshFlags(CLI::App& command, MeshFlags& flags) {
  command
      .add_option("--input-format", flags.input_format,
                  Wrapped("Format of the mesh file (default auto: by its content, then by its extension)"))
      ->type_name(absl::StrJoin(MeshFormatNames(), "|"))
      ->check(CLI::IsMember(MeshFormatNames()));
  command
      .add_option("--unit", flags.unit,
                  Wrapped("Unit of the positions in a file whose format has none (stl, ply, off, obj, drc), which are "
                          "then scaled to metres; without it they are taken as they are"))
      ->type_name(absl::StrJoin(UnitNames(), "|"))
      ->check(CLI::IsMember(UnitNames()));
  command.add_flag("--allow-outside", flags.allow_outside,
                   Wrapped("Also read files that a glTF or OBJ file names outside its directory, by .. or through a "
                           "link; otherwise they are refused"));
}

}  // namespace voxelpipe::cli
