// Requests of A-buffers for batches.
#pragma once

#include <vector>

#include "gpu/parity_cases.h"

namespace voxelpipe::gpu {

// Both coverages, layouts and kinds of grid, from one voxel to odd sizes; targets of every width, of shaders that discard, and none but such.
// The last one is refused: center coverage has no A-buffer. For meshes about [0, 40].
std::vector<ParityCase> ABufferCases();
// What every mesh has: occupied voxels, ids, positions; for meshes that are `large`, or lie anywhere.
VoxelizeRequest FittedABuffer(int64_t resolution, bool shaded);

}  // namespace voxelpipe::gpu
