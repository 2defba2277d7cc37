// Client side only: makes an OBJ file self-contained.
#pragma once

#include <filesystem>
#include <optional>
#include <span>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/file_bytes.h"
#include "load/pack.h"
#include "mesh/scene/load_limits.h"

namespace voxelpipe {

// In: an OBJ file and its directory. Out: the same file with the material libraries that it names, and their textures,
// as data: URIs; empty if it names no file. A texture is written once, with its name, and later statements name it. A
// library is written where it is named first, and left out of later statements. The rules are those of PackMesh: files
// outside the directory are refused unless `outside` allows them, if a shader reads materials at all; missing ones stay
// names, of which the loader warns. Errors: INVALID_ARGUMENT naming file and line, RESOURCE_EXHAUSTED past
// max_file_bytes or the job's memory; the job's. May throw bad_alloc.
absl::StatusOr<std::optional<FileBytes>> PackObj(const JobContext& job, std::span<const uint8_t> bytes,
                                                 const std::filesystem::path& directory, const LoadLimits& limits,
                                                 const OutsideFiles& outside);

}  // namespace voxelpipe
