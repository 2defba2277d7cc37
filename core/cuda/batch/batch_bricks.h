// Makes the bricks of a small sparse result on the host from the dense data that a batch reads back.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "job/result.h"

namespace voxelpipe::cuda {

// `occupied`, `covered`: packed bits of the whole grid, each readable for 8 bytes past its end. Covered voxels have a
// fragment (null: all occupied voxels); the others are filled. Fills bricks, masks and targets of `result`, whose grid
// and specs are set and whose targets are occupancy bits. RESOURCE_EXHAUSTED if memory is short.
absl::Status BricksOfBits(const uint8_t* occupied, const uint8_t* covered, VoxelizeResult& result);

// The same for any targets: `dense` has each target's dense result, in the result's layout.
absl::Status BricksOfDense(const uint8_t* occupied, const std::vector<const uint8_t*>& dense, VoxelizeResult& result);

}  // namespace voxelpipe::cuda
