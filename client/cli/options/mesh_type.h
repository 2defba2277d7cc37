// How the mesh files of a command or a manifest are to be read.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "load/decode/mesh_format.h"

namespace voxelpipe::cli {

// The values of --input-format, --unit and --allow-outside.
struct MeshFlags {
  bool allow_outside = false;               // files may name others outside their directory
  std::string unit, input_format = "auto";  // of all files; empty unit: none
};

// The values that --input-format and --unit take.
std::vector<std::string> MeshFormatNames();
std::vector<std::string> UnitNames();

// In: the value of --input-format, or of a manifest's "input_format"; and that of --unit, may be empty.
// INVALID_ARGUMENT naming the option and its choices.
absl::StatusOr<MeshFileType> MeshTypeOf(const std::string& input_format, const std::string& unit);

}  // namespace voxelpipe::cli
