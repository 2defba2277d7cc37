// Dense targets that are written by rows, with the few largest triangles drawn in them (sum_rows.cuh, fill_rows.cuh): parts of rows, the order in
// which they are written, and those triangles. No host-only includes.
#pragma once

#include "cuda/piece_layers.cuh"
#include "cuda/span_kernels.cuh"

namespace voxelpipe::cuda {

inline constexpr int kRowCells = 1024;  // of a part of a row, in shared memory: 4 KiB

// A part of a row of the slab.
struct RowPartPlace {
  int x = 0, y = 0, z = 0;  // its first voxel in the grid
  uint32_t words = 0;       // of coverage; 0: there is no such part
  uint64_t word = 0;        // its first, of the slab
};

// The parts of all rows, of at most so many words, by items of some rows that lie one behind the other, as items do. Where blocks write item after
// item, what is under way lies together: memory takes such stores a fifth faster than those of warps that each go their own way.
struct RowOrder {
  __device__ RowOrder(const GridView& of_grid, uint32_t most_words, uint32_t rows_of_item)
      : grid(of_grid), most(most_words), rows(rows_of_item) {
    along_x = (uint32_t(grid.words_per_row) + most - 1) / most;
    along_y = (uint32_t(grid.dims[1]) + rows - 1) / rows;
    count = along_x * along_y * uint32_t(grid.slab_end - grid.slab_begin);
  }
  // The part of an item's row.
  __device__ RowPartPlace Find(uint32_t item, uint32_t row) const {
    RowPartPlace place;
    const uint32_t yz = item / along_x, z = yz / along_y, y = (yz - z * along_y) * rows + row;
    const uint32_t first = (item - yz * along_x) * most, ny = uint32_t(grid.dims[1]);
    if (item >= count || y >= ny) return place;
    place.x = int(first * 32);
    place.y = int(y);
    place.z = int(grid.slab_begin) + int(z);
    place.words = min(most, uint32_t(grid.words_per_row) - first);
    place.word = (uint64_t{z} * ny + y) * uint32_t(grid.words_per_row) + first;
    return place;
  }

  const GridView& grid;
  uint32_t most, rows, along_x, along_y, count;
};

// Sets up the triangles that are drawn apart, and calls take(number of it, triangle) for each; how many there are. One that is not drawn apart in
// this grid has no layers. All threads of a block call it.
template <typename Take>
__device__ inline uint32_t SetUpApart(const BitArgs& walk, SharedSetup* setups, Take&& take) {
  static_assert(kMostApart <= 32);  // a lane each
  if (walk.largest == nullptr) return 0;
  const uint32_t count = walk.largest->listed();
  if (threadIdx.x < count) {
    const uint32_t t = walk.largest->triangles[threadIdx.x];
    SharedSetup& s = setups[threadIdx.x];
    if (SetUpRows(walk, t, s) <= kRowsOfWarp) s.begin[2] = s.end[2] = 0;
    take(threadIdx.x, t);
  }
  __syncthreads();
  return count;
}

// Bits [begin, end) of a row of words: take(word, mask).
template <typename Take>
__device__ inline void ForEachWordOf(int begin, int end, Take&& take) {
  for (int x = begin; x < end;) {
    const int upto = min(end, (x | 31) + 1);
    take(x / 32, ~0u >> (32 - (upto - x)) << x % 32);
    x = upto;
  }
}

}  // namespace voxelpipe::cuda
