// The content hash of a result.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "pipeline/voxelize.h"

namespace voxelpipe::cli {

// SHA-256, 64 lower-case hexadecimal digits, of the bytes of all targets one after the other.
absl::StatusOr<std::string> HashResult(const VoxelizeResult& result);

}  // namespace voxelpipe::cli
