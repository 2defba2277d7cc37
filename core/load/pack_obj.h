// Client side only: makes an OBJ file self-contained.
#pragma once

#include <filesystem>
#include <optional>
#include <span>

#include "absl/status/statusor.h"
#include "load/file_bytes.h"
#include "load/pack.h"
#include "mesh/scene/load_limits.h"

namespace voxelpipe {

// In: an OBJ file and its directory. Out: the same file with the material libraries that it names, and their textures,
// as data: URIs; empty if it names no file. A texture is written once, with its name, and later statements name it. The
// rules are those of PackMesh: files outside the directory are refused unless `outside` allows them, if a shader reads
// materials at all; missing ones stay names, of which the loader warns. Errors: INVALID_ARGUMENT naming file and line,
// RESOURCE_EXHAUSTED past max_file_bytes. May throw bad_alloc.
absl::StatusOr<std::optional<FileBytes>> PackObj(std::span<const uint8_t> bytes, const std::filesystem::path& directory,
                                                 const LoadLimits& limits, const OutsideFiles& outside);

}  // namespace voxelpipe
