// Bricks of a small sparse result, made on the host of what a batch brings back of its whole grid.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "job/result.h"

namespace voxelpipe::cuda {

// In: packed bits of the whole grid, each readable for 8 bytes beyond its end: `occupied` voxels, and of these the
// `covered` ones (null where all are), which have a fragment; the others are filled. Out: bricks, masks and targets of
// `result`, whose grid and specs are set and plain bits. RESOURCE_EXHAUSTED when memory is short.
absl::Status BricksOfBits(const uint8_t* occupied, const uint8_t* covered, VoxelizeResult& result);

// The same of any targets: `dense` has for each what its dense result would be, in the result's layout.
absl::Status BricksOfDense(const uint8_t* occupied, const std::vector<const uint8_t*>& dense, VoxelizeResult& result);

}  // namespace voxelpipe::cuda
