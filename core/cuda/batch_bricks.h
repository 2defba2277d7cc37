// Bricks of a small sparse result of plain bits, made on the host of the packed bits that a batch brings back.
#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "pipeline/result.h"

namespace voxelpipe::cuda {

// In: packed bits of the whole grid, each readable for 8 bytes beyond its end: `occupied` voxels, and of these the `covered` ones (null
// where all are), which have a fragment; the others are filled. Out: bricks, masks and targets of `result`, whose grid and specs are set.
// RESOURCE_EXHAUSTED when memory is short.
absl::Status BricksOfBits(const uint8_t* occupied, const uint8_t* covered, VoxelizeResult& result);

}  // namespace voxelpipe::cuda
