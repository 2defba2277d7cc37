// Blends into bricks of a sparse result that are allocated on demand: the first warp that touches a brick takes a slot
// of a pool for it, and values are blended there. So triangles are rasterized once, and the only array proportional to
// the grid is a table of its bricks (cf. C. Crassin et al., "GigaVoxels", I3D 2009, for rendering).
//
// Blends are max blends of keys that are never 0: key 0 marks a voxel that was not touched. If the pool overflows the
// values are lost; the number of requested slots shows it. No host-only includes.
#pragma once

#include "cuda/primitives/atomics.cuh"
#include "cuda/primitives/brick_allocator.cuh"
#include "cuda/primitives/list_sizes.h"
#include "cuda/primitives/views.h"

namespace voxelpipe::cuda {

struct BrickPool {
  static constexpr uint32_t kWordsOfPlace = kBrickCells;
  uint32_t* places = nullptr;  // slot table: four bricks per tile of the slab, in tile order
  uint32_t* cells = nullptr;   // kBrickCells per slot
  uint32_t* bricks = nullptr;  // per slot: index of its brick in `places`
  uint64_t* asked = nullptr;   // counter: bricks that asked for a slot
  uint32_t capacity = 0;       // slots
  uint32_t tiles_x = 1, tiles_y = 1;

  __device__ uint32_t* WordsOf(uint64_t place) const { return cells + place * kWordsOfPlace; }
  __device__ void Name(uint64_t place, uint32_t brick) const { bricks[place] = brick; }
};

__device__ inline uint32_t BrickAt(const BrickPool& pool, int x, int y, int z) {
  const uint32_t tile = uint32_t(x) / 4 + pool.tiles_x * (uint32_t(y) + pool.tiles_y * uint32_t(z));
  return tile * 4 + uint32_t(x) % 4;
}

// Addresses voxels relative to a first voxel within bricks. `brick` contains one chosen voxel; `first` is the cell
// index, relative to that brick, that the first voxel would have there (may be out of range).
struct InBrick {
  uint32_t brick;
  int first;
  int low[3];  // the brick's first voxel, relative to the first voxel

  // `voxel`: the chosen voxel, relative to voxel `first_voxel` of the slab.
  __device__ InBrick(const BrickPool& pool, const int (&first_voxel)[3], const int (&voxel)[3]) {
    int at[3];
#pragma unroll
    for (int a = 0; a < 3; ++a) {
      at[a] = (first_voxel[a] + voxel[a]) >> 3;
      low[a] = 8 * at[a] - first_voxel[a];
    }
    brick = BrickAt(pool, at[0], at[1], at[2]);
    first = -(low[0] + 8 * (low[1] + 8 * low[2]));
  }
};

__device__ inline uint32_t* CellsAt(const BrickPool& pool, uint32_t place) {
  return pool.cells + uint64_t{place - kFirstPlace} * kBrickCells;
}

// Blends a key into the voxels of a 2x2x2 mask (`octants`) whose first voxel is `first` of the slab. All lanes of a
// warp call it.
__device__ inline void BlendOctantsInPool(const BrickPool& pool, const int (&first)[3], uint32_t octants,
                                          uint32_t key) {
  constexpr uint32_t kNear[3] = {0x55, 0x33, 0x0f};
  while (__any_sync(~0u, octants != 0) != 0) {
    const int n = octants == 0 ? 0 : __ffs(int(octants)) - 1;
    const InBrick in(pool, first, {n & 1, n >> 1 & 1, n >> 2});
    uint32_t here = octants;
#pragma unroll
    for (int a = 0; a < 3; ++a) {
      if (in.low[a] == 1) here &= ~kNear[a];
      if (in.low[a] == -7) here &= kNear[a];
    }
    const uint32_t place = PlaceOf(pool, octants != 0, in.brick);
    if (IsPlace(place)) {
      uint32_t* const cells = CellsAt(pool, place) + in.first;
#pragma unroll
      for (int i = 0; i < 8; ++i) {
        if ((here >> i & 1) != 0) ReduceMax(cells + (i & 1) + 8 * (i >> 1 & 1) + 64 * (i >> 2), key);
      }
    }
    octants &= ~here;
  }
}

// The same for a block of 4x4x4 voxels, x + 4y + 16z.
__device__ inline void BlendBlockInPool(const BrickPool& pool, const int (&first)[3], uint64_t mask, uint32_t key) {
  while (__any_sync(~0u, mask != 0) != 0) {
    const int n = mask == 0 ? 0 : __ffsll(static_cast<long long>(mask)) - 1;
    const InBrick in(pool, first, {n & 3, n >> 2 & 3, n >> 4});
    // Masks of the voxels from low to low + 8 of each axis.
    constexpr int kStep[3] = {1, 4, 16};
    constexpr uint64_t kPlane[3] = {0x1111'1111'1111'1111, 0x000f'000f'000f'000f, 0xffff};
    uint64_t here = mask;
#pragma unroll
    for (int a = 0; a < 3; ++a) {
#pragma unroll
      for (int i = 0; i < 4; ++i) {
        if (i < in.low[a] || i >= in.low[a] + 8) here &= ~(kPlane[a] << kStep[a] * i);
      }
    }
    const uint32_t place = PlaceOf(pool, mask != 0, in.brick);
    if (IsPlace(place)) {
      uint32_t* const cells = CellsAt(pool, place) + in.first;
      for (uint64_t left = here; left != 0; left &= left - 1) {
        const int i = __ffsll(static_cast<long long>(left)) - 1;
        ReduceMax(cells + (i & 3) + 8 * (i >> 2 & 3) + 64 * (i >> 4), key);
      }
    }
    mask &= ~here;
  }
}

}  // namespace voxelpipe::cuda
