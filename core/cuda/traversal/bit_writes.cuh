// Writes the voxels of small triangles to the words of a bit grid: 2x2x2 masks, by a lane or combined over a warp, and
// rows within a box. No host-only includes.
#pragma once

#include "cuda/traversal/raster_args.cuh"
#include "raster/filtered/small_triangle_rows.h"

namespace voxelpipe::cuda {

// Clips the 2x2x2 mask of a box that starts at voxel `first` to the grid.
__device__ inline uint32_t ClipOctants(const BitArgs& args, const int (&first)[3], uint32_t octants) {
  const int nx = int(args.grid.dims[0]), ny = int(args.grid.dims[1]);
  const int z_begin = int(args.grid.slab_begin), z_end = int(args.grid.slab_end);
  if (first[0] < 0) octants &= 0xaa;
  if (first[0] + 1 >= nx) octants &= 0x55;
  if (first[1] < 0) octants &= 0xcc;
  if (first[1] + 1 >= ny) octants &= 0x33;
  if (first[2] < z_begin) octants &= 0xf0;
  if (first[2] + 1 >= z_end) octants &= 0x0f;
  return octants;
}

// Sets the voxels of a 2x2x2 mask of a box that starts at voxel `first`, clipped to the grid.
__device__ inline void SetOctants(const BitArgs& args, const int (&first)[3], uint32_t octants) {
  const int ny = int(args.grid.dims[1]), z_begin = int(args.grid.slab_begin);
  octants = ClipOctants(args, first, octants);
  const auto pitch = int64_t(args.grid.words_per_row);
  const int64_t row = int64_t{ny} * (first[2] - z_begin) + first[1];
  uint32_t* const near = args.bits + (row * pitch + (first[0] >> 5));
  uint32_t* const far = near + pitch * ny;
  const int shift = first[0] & 31;
  const auto pair = [octants](int i) { return octants >> 2 * i & 3; };
  if (shift < 31) {
    if (pair(0) != 0) ReduceOr(near, pair(0) << shift);
    if (pair(1) != 0) ReduceOr(near + pitch, pair(1) << shift);
    if (pair(2) != 0) ReduceOr(far, pair(2) << shift);
    if (pair(3) != 0) ReduceOr(far + pitch, pair(3) << shift);
    return;
  }
  for (int i = 0; i < 4; ++i) {
    uint32_t* const word = ((i & 2) != 0 ? far : near) + ((i & 1) != 0 ? pitch : 0);
    if ((pair(i) & 1) != 0) ReduceOr(word, 1u << 31);
    if ((pair(i) & 2) != 0) ReduceOr(word + 1, 1);
  }
}

// Addresses the grid's words near a box of voxels with few operations per row.
class NearWords {
 public:
  // `begin`: the box's first voxel within the grid. Along x the unclipped box starts at `first`.
  __device__ NearWords(const BitArgs& args, const int (&begin)[3], int first)
      : first_(args.bits + args.grid.Word(begin[0], begin[1], begin[2])),
        shift_((begin[0] & 31) - (begin[0] - first)),
        row_(uint32_t(args.grid.words_per_row)),
        layer_(row_ * uint32_t(args.grid.dims[1])) {}
  // Interface of VisitCells, for at most kMaxCells voxels per row.
  __device__ void Layer(int z) {
    layer_begins_ = first_ + uint64_t{uint32_t(z)} * layer_;
#if defined(__CUDA_ARCH__)
    asm volatile("" : "+l"(layer_begins_));  // prevents recomputation for each row
#endif
  }
  __device__ void Row(int y, int x, int count) const {
    const auto at = uint32_t(shift_ + x), bit = at % 32;
    uint32_t* const word = layer_begins_ + (uint32_t(y) * row_ + at / 32);
    ReduceOr(word, BitsFrom(bit, count));
    const int beyond = int(bit) + count - 32;
    if (beyond > 0) ReduceOr(word + 1, BitsFrom(0, beyond));
  }

 private:
  uint32_t* first_;  // the word of the first voxel
  int shift_;
  uint32_t row_, layer_;
  uint32_t* layer_begins_ = nullptr;
};

// Combines the 2x2x2 masks of adjacent lanes with the same first voxel, to save atomics, which dominate. The mask of a
// lane that another lane takes over becomes 0. All threads of a warp call it.
__device__ inline uint32_t Together(const int (&first)[3], uint32_t octants) {
  const unsigned lane = threadIdx.x % 32;
  // Fixed-point voxel coordinates have 16 bits.
  const uint32_t xy = (uint32_t(first[0]) & 0xffff) | uint32_t(first[1]) << 16;
  const bool other_xy = __shfl_up_sync(~0u, xy, 1) != xy, other_z = __shfl_up_sync(~0u, first[2], 1) != first[2];
  const bool is_head = lane == 0 || other_xy || other_z;
  const unsigned heads = __ballot_sync(~0u, is_head);
  if (heads != ~0u) {
    const unsigned above = heads & ~((2u << lane) - 1);
    const unsigned end = above == 0 ? 32 : unsigned(__ffs(int(above))) - 1;
    for (unsigned step = 1; step < 32; step *= 2) {
      const uint32_t there = __shfl_down_sync(~0u, octants, step);
      if (lane + step < end) octants |= there;
    }
  }
  return is_head ? octants : 0;
}

__device__ inline void SetOctantsTogether(const BitArgs& args, const int (&first)[3], uint32_t octants) {
  octants = Together(first, octants);
  if (octants != 0) SetOctants(args, first, octants);
}

}  // namespace voxelpipe::cuda
