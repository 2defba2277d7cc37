// Per-warp tile of voxel bits in shared memory: neighbours in a mesh touch the same words of the grid, which are then
// written once. The tile is a box of rows; each row is a 32-bit word that starts at the box's first voxel, so that no
// row of a triangle is split. No host-only includes.
#pragma once

#include "cuda/primitives/warp_reduce.cuh"
#include "cuda/traversal/raster_args.cuh"

namespace voxelpipe::cuda {

// The tile of a warp, for triangles within kRows rows.
template <uint32_t kRows>
struct RowBoxOf {
  alignas(16) uint32_t rows[kRows];
  int first[3];  // first voxel
  uint32_t size_y, count;
};
// For RowKernel. The size leaves its blocks as much L1 cache as those of CellKernel; 128 and 512 rows are about 3 %
// slower.
using RowBox = RowBoxOf<336>;
// For 2x2x2 masks in CellKernel; its rows are zero between uses.
using OctantBox = RowBoxOf<128>;

// Clears the tile. All lanes call it, then __syncwarp before FitRows.
template <uint32_t kRows>
__device__ inline void ClearRows(RowBoxOf<kRows>& box) {
  for (uint32_t i = threadIdx.x % 32; i < kRows / 4; i += 32) {
    reinterpret_cast<uint4*>(box.rows)[i] = uint4{0, 0, 0, 0};
  }
}

// The layout of a tile; uniform over the warp.
struct RowPlace {
  int x = 0, offset = 0;
  int pitch = 0;  // rows per layer; 0: the triangles do not fit, and their bits are set in the grid

  __device__ bool fits() const { return pitch != 0; }
  // The row of a voxel.
  __device__ uint32_t RowOf(const int (&voxel)[3]) const { return uint32_t(offset + voxel[1] + voxel[2] * pitch); }
};

// Lays out the tile for the bounding box of voxels [begin, end) of the lanes with `has`. All lanes call it, after the
// rows are cleared and __syncwarp.
template <uint32_t kRows>
__device__ inline RowPlace FitRows(RowBoxOf<kRows>& box, bool has, const int (&begin)[3], const int (&end)[3]) {
  uint32_t least[3], size[3];
  for (int a = 0; a < 3; ++a) {
    least[a] = WarpLeast(has ? uint32_t(begin[a]) : ~0u);
    size[a] = WarpLargest(has ? uint32_t(end[a]) : 0u) - least[a];
  }
  RowPlace place;
  if (least[0] == ~0u || size[0] > 32 || size[1] > kRows || size[2] > kRows || size[1] * size[2] > kRows) {
    return place;
  }
  place.x = int(least[0]);
  place.pitch = int(size[1]);
  place.offset = -(int(least[1]) + int(least[2]) * place.pitch);
  if (threadIdx.x % 32 == 0) {
    for (int a = 0; a < 3; ++a) box.first[a] = int(least[a]);
    box.size_y = size[1];
    box.count = size[1] * size[2];
  }
  return place;
}

// i / n for numbers up to 1,000; `inverse`: 1 / n with an error of at most 2^-22.
__device__ inline uint32_t DivideSmall(uint32_t i, float inverse) {
  return uint32_t((float(i) + 0.5f) * inverse);
}

// Writes the rows to the grid and clears them. All lanes call it, after all have set their rows and __syncwarp; another
// __syncwarp must follow before rows are set again.
template <uint32_t kRows>
__device__ inline void StoreRows(const BitArgs& args, RowBoxOf<kRows>& box) {
  const uint32_t count = box.count, size_y = box.size_y;
  const float inverse = Reciprocal(float(size_y));
  const int shift = box.first[0] & 31;
  uint32_t* const grid = args.bits + (box.first[0] >> 5);
  for (uint32_t i = threadIdx.x % 32; i < count; i += 32) {
    const uint64_t bits = uint64_t{box.rows[i]} << shift;
    if (bits == 0) continue;
    box.rows[i] = 0;
    const uint32_t z = DivideSmall(i, inverse);
    uint32_t* const to = grid + args.grid.Word(0, box.first[1] + int(i - z * size_y), box.first[2] + int(z));
    if (uint32_t(bits) != 0) ReduceOr(to, uint32_t(bits));
    if (uint32_t(bits >> 32) != 0) ReduceOr(to + 1, uint32_t(bits >> 32));
  }
}

}  // namespace voxelpipe::cuda
