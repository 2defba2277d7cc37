// The values of filled voxels without a fragment, by definition: the shader's value at the voxel's centre if it needs
// no triangle.
#pragma once

#include <cstdint>

#include "grid/grid_spec.h"
#include "job/request.h"

namespace voxelpipe::testing {

// Component c of target `index` at the voxel, as stored in the target's format: the low 1, 8, 16 or 32 bits.
uint32_t ReferenceFill(const VoxelizeRequest& request, size_t index, const GridSpec& grid, int64_t x, int64_t y,
                       int64_t z, int c);

}  // namespace voxelpipe::testing
