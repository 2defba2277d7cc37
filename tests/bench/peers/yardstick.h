// The baseline of any voxelizer: the plain loop.
#pragma once

#include <cstdint>
#include <vector>

#include "grid/grid_spec.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe::bench {

// Packed bits of the voxels that triangles touch: for each triangle, for each voxel of its box, the overlap test of T.
// Akenine-Moller ("Fast 3D Triangle-Box Overlap Testing", 2001) in double, one thread, nothing precomputed. Rounding
// decides ties.
std::vector<uint8_t> PlainLoop(const TriangleMesh& mesh, const GridSpec& grid);

}  // namespace voxelpipe::bench
