// The options about mesh files, the same for every command that reads them.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "absl/status/statusor.h"
#include "load/decode/mesh_format.h"

namespace voxelpipe::cli {

struct MeshFlags {
  bool allow_outside = false;               // files may name others outside their directory
  std::string unit, input_format = "auto";  // of all files; empty unit: none
};

// Adds --input-format, --unit and --allow-outside; `flags` must outlive the command.
void AddMeshFlags(CLI::App& command, MeshFlags& flags);

// In: the value of --input-format, or of a manifest's "input_format"; and that of --unit, may be empty.
// INVALID_ARGUMENT naming the option and its choices.
absl::StatusOr<MeshFileType> MeshTypeOf(const std::string& input_format, const std::string& unit);

}  // namespace voxelpipe::cli
