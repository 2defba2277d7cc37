// Requests of solids: coverage none, signed crossings, what filled voxels hold by default, sRGB, and fitted grids with
// walls.
#pragma once

#include <vector>

#include "gpu/cases/parity_cases.h"

namespace voxelpipe::gpu {

// A fitted grid of about n voxels an axis, whose last voxels end a little before the mesh's box does: the mesh is moved
// to its walls (grid/index_space.h). `share`: of what walls take at most, beyond them.
GridRequest WalledGrid(const TriangleMesh& mesh, int64_t n, double share);

// `quick`: each way once.
std::vector<ParityCase> SolidCases(const TriangleMesh& mesh, bool quick);

}  // namespace voxelpipe::gpu
