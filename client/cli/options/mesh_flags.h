// The options about mesh files, the same for every command that reads them.
#pragma once

#include "command_line/command.h"
#include "options/mesh_type.h"

namespace voxelpipe::cli {

// Adds --input-format, --unit and --allow-outside; `flags` must outlive the command.
void AddMeshFlags(Command& command, MeshFlags& flags);

}  // namespace voxelpipe::cli
