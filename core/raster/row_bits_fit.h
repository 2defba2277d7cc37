// The grids whose occupancy bits can be set row by row.
#pragma once

#include <algorithm>
#include <cstdint>

#include "grid/grid_spec.h"

namespace voxelpipe {

// Voxels along an axis of a grid for which the voxels that a vertex touches fit a 16-bit code.
inline constexpr int64_t kMaxCodedDim = 16000;

// True if the paths that set rows of bits, on the CPU and on CUDA, take the grid and this number of triangles.
inline bool RowBitsFit(const GridSpec& grid, uint64_t triangles) {
  return std::max({grid.dims[0], grid.dims[1], grid.dims[2]}) <= kMaxCodedDim && triangles < UINT32_MAX;
}

}  // namespace voxelpipe
