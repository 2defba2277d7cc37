// Requests for batches of A-buffers and of flood fills.
#pragma once

#include <vector>

#include "gpu/cases/parity_cases.h"

namespace voxelpipe::gpu {

// For meshes about [0, 40]. Buckets of both coverages, layouts and kinds of grid, from one voxel to odd sizes; targets
// of every width, with shaders that discard, and with only such shaders. One is refused: center coverage has no
// A-buffer. And occupancy bits of a grid that is too long for rows.
std::vector<ParityCase> FragmentCases();
// What every mesh has: occupied voxels, ids, positions; for meshes that are `large`, or lie anywhere.
VoxelizeRequest FittedABuffer(int64_t resolution, bool shaded);

// Dense and sparse, every coverage, with the targets of A-buffers, other values where nothing is and where it is
// filled; grids from one voxel to some of several words a row. For meshes about [0, 40].
std::vector<ParityCase> FloodCases();
// A closed box about [0, 21] but for a hole, from which a winding corridor leads through `levels` of ten passages each,
// up to 10 levels: a flood through it turns twice for each passage.
TriangleMesh Labyrinth(int levels);
// Bits of it, or values.
VoxelizeRequest FloodOfLabyrinth(bool shaded);

}  // namespace voxelpipe::gpu
