// Requests of solids: coverage none, signed crossings, default values of filled voxels, sRGB, and fitted grids with
// walls.
#pragma once

#include <vector>

#include "gpu/cases/parity_cases.h"

namespace voxelpipe::gpu {

// A fitted grid of about n voxels an axis, which ends a little before the mesh's box: vertices are moved to its walls
// (grid/index_space.h). `share`: the distance beyond the walls, as a share of the maximum.
GridRequest WalledGrid(const TriangleMesh& mesh, int64_t n, double share);

// `quick`: each path once.
std::vector<ParityCase> SolidCases(const TriangleMesh& mesh, bool quick);

}  // namespace voxelpipe::gpu
