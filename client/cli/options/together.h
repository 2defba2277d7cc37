// Several meshes on one grid: --together, its list file, and "meshes" of a manifest.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "absl/status/statusor.h"
#include "mesh/placed_mesh.h"

namespace voxelpipe::cli {

// A mesh of several on one grid: `placement.mesh` is set when its file is loaded.
struct PlacedInput {
  size_t file = 0;  // its number in a list of files
  PlacedMesh placement;
};

// Meshes by the paths of their files.
struct Together {
  std::vector<std::string> paths;   // each once
  std::vector<PlacedInput> placed;  // in order; a placement's `file` is an index into `paths`
};

// Each path is one mesh where its file has it; its name is the file's. INVALID_ARGUMENT beyond kMaxPlacedMeshes.
absl::StatusOr<Together> TogetherOf(const std::vector<std::string>& paths);

// In: a list of objects, {"input", "matrix", "name", "label", "priority", "motion"}, all optional but the input; the
// directory in which relative inputs are searched first, before the working directory. A matrix is 16 numbers, row by
// row, or 4 lists of 4; a motion is {"linear", "angular", "center"}, 3 numbers each. Errors: INVALID_ARGUMENT
// "meshes[2].matrix: what is wrong".
absl::StatusOr<Together> ParseTogether(const nlohmann::json& meshes, const std::string& directory);

// In: the path of a file {"meshes": [...]}. Errors: those of ParseTogether with the path, and the system's.
absl::StatusOr<Together> ReadTogether(const std::string& path);

// The value of --together that stands for the IN of the command.
inline constexpr char kTogetherInputs[] = "IN";

// In: what follows the program's name. Out: the same, with kTogetherInputs as the value of a --together that no list
// file (.json) follows: it has a value only where one is meant.
std::vector<std::string> WithTogetherValue(std::vector<std::string> arguments);

// `input` below `directory`, unless it is absolute or only the working directory has it.
std::string FindBeside(const std::string& directory, const std::string& input);

// A text that is equal for equal placements of the same files.
std::string PlacingText(const std::vector<PlacedInput>& placed);

// How a report calls them: "a.stl + b.stl + 3 more".
std::string NameOf(const Together& together);

}  // namespace voxelpipe::cli
