#include "options/mesh_flags.h"

#include "absl/strings/str_join.h"
#include "options/request_flags.h"

namespace voxelpipe::cli {

void AddMeshFlags(Command& command, MeshFlags& flags) {
  command
      .AddOption("--input-format", flags.input_format,
                 Wrapped("Format of the mesh file (default auto: by its content, then by its extension)"))
      .Type(absl::StrJoin(MeshFormatNames(), "|"))
      .Choices(MeshFormatNames());
  command
      .AddOption("--unit", flags.unit,
                 Wrapped("Unit of the positions in a file whose format has none (stl, ply, off, obj, drc), which are "
                         "then scaled to metres; without it they are taken as they are"))
      .Type(absl::StrJoin(UnitNames(), "|"))
      .Choices(UnitNames());
  command.AddFlag("--allow-outside", flags.allow_outside,
                  Wrapped("Also read files that a glTF or OBJ file names outside its directory, by .. or through a "
                          "link; otherwise they are refused"));
}

}  // namespace voxelpipe::cli
