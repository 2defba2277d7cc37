// Kernels for a brick pool (brick_scatter.cuh): blend the rows of deferred triangles into it, and convert it to a
// sparse result. No host-only includes.
#pragma once

#include "cuda/coverage/atomic_blend.cuh"
#include "cuda/coverage/brick_scatter.cuh"
#include "cuda/coverage/emit_spans.cuh"
#include "cuda/primitives/fast_divide.h"
#include "cuda/primitives/warp_reduce.cuh"

namespace voxelpipe::cuda {

inline constexpr int kPoolThreads = 256;

struct PoolWriterArgs {
  BrickPool pool;
  InPlaceArgs blend;
  Divisor by_ny;
  uint64_t* fragments = nullptr;  // kFragmentSlots counters
};

// A row writer (emit_spans.cuh) that blends into the pool. kShader: as for ValuesOf.
template <int kShader>
class PoolWriter {
 public:
  using Args = PoolWriterArgs;
  static constexpr bool kPartsInRow = false;
  __device__ PoolWriter(const PoolWriterArgs& args, uint32_t) : args_(args) {}

  __device__ void Put(uint32_t t, uint32_t row, int x_begin, int x_end) {
    uint32_t key[1] = {};
    int y = 0, z = 0;
    if (x_begin < x_end) {
      fragments_ += uint32_t(x_end - x_begin);
      z = int(Quotient(row, args_.by_ny));
      y = int(row) - z * int(args_.by_ny.divisor);
      KeysOf<kShader, 1>(args_.blend, false, t, key);
    }
    while (__any_sync(~0u, x_begin < x_end) != 0) {
      const bool blends = x_begin < x_end;
      const uint32_t place = PlaceOf(args_.pool, blends, BrickAt(args_.pool, x_begin / 8, y / 8, z / 8));
      const int end = min(x_end, (x_begin | 7) + 1);
      if (IsPlace(place)) {
        uint32_t* const cells = CellsAt(args_.pool, place) + 8 * (y % 8 + 8 * (z % 8));
        for (int x = x_begin; x < end; ++x) ReduceMax(cells + x % 8, key[0]);
      }
      if (blends) x_begin = end;
    }
  }
  __device__ void Finish() {
    __syncwarp();
    AddFragments(args_.fragments, fragments_);
  }

 private:
  const PoolWriterArgs& args_;
  uint64_t fragments_ = 0;
};

struct PoolResultArgs {
  BrickPool pool;
  uint32_t *masks = nullptr,
           *voxels = nullptr;  // per slot: 16 words with a bit for each touched cell, and the number of these bits
  // Per tile of the slab; one more element, 0, so that the prefix sum ends with the total.
  uint64_t tiles = 0;
  uint32_t *brick_counts = nullptr, *voxel_counts = nullptr;
  const uint64_t *first_brick = nullptr, *first_voxel = nullptr;
  // Bricks of the grid, and the result.
  uint64_t bricks_x = 1, bricks_y = 1, first_layer = 0;
  uint64_t* bricks = nullptr;
  uint32_t* out_masks = nullptr;
  uint8_t* out = nullptr;
  VoxelFormat format{};  // a float format
  bool complement = false;
  // If not null, keys are owners (OwnerOf): outputs two lists, the voxel indices within the slab and their owners.
  uint32_t *voxel_keys = nullptr, *owners = nullptr;
  uint32_t nx = 1, ny = 1;
};

// Cell 128 * i + 4 * lane + k of a brick: cell k of 16-byte unit i of a lane.
inline constexpr int kUnitsOfLane = 4;

// Number of allocated slots; uniform over all threads.
__device__ inline uint32_t GivenPlaces(const BrickPool& pool) {
  return uint32_t(min(*pool.asked, uint64_t{pool.capacity}));
}

// Finds the touched cells of each slot. One warp per slot.
__global__ void __launch_bounds__(kPoolThreads) MaskPlaces(const __grid_constant__ PoolResultArgs args) {
  const uint32_t given = GivenPlaces(args.pool), lane = threadIdx.x % 32;
  for (uint32_t place = (blockIdx.x * kPoolThreads + threadIdx.x) / 32; place < given;
       place += gridDim.x * (kPoolThreads / 32)) {
    const auto* const units = reinterpret_cast<const uint4*>(args.pool.cells + uint64_t{place} * kBrickCells);
    uint32_t voxels = 0;
#pragma unroll
    for (int i = 0; i < kUnitsOfLane; ++i) {
      const uint4 four = units[uint32_t(i) * 32 + lane];
      uint32_t word =
          (four.x != 0 ? 1u : 0u) | (four.y != 0 ? 2u : 0u) | (four.z != 0 ? 4u : 0u) | (four.w != 0 ? 8u : 0u);
      voxels += uint32_t(__popc(word));
      word <<= 4 * (lane % 8);
#pragma unroll
      for (int step = 1; step < 8; step *= 2) word |= __shfl_xor_sync(~0u, word, step);
      if (lane % 8 == 0) args.masks[place * 16 + uint32_t(i) * 4 + lane / 8] = word;
    }
    voxels = WarpSum(voxels);
    if (lane == 0) args.voxels[place] = voxels;
  }
}

// Counts bricks and voxels per tile. One thread per tile.
__global__ void __launch_bounds__(kPoolThreads) CountTiles(const __grid_constant__ PoolResultArgs args) {
  const uint64_t tile = uint64_t(blockIdx.x) * kPoolThreads + threadIdx.x;
  if (tile > args.tiles) return;
  uint32_t bricks = 0, voxels = 0;
  if (tile < args.tiles) {
    const uint4 four = reinterpret_cast<const uint4*>(args.pool.places)[tile];
    const uint32_t places[4] = {four.x, four.y, four.z, four.w};
    for (int p = 0; p < 4; ++p) {
      if (!IsPlace(places[p])) continue;
      ++bricks;
      voxels += args.voxels[places[p] - kFirstPlace];
    }
  }
  args.brick_counts[tile] = bricks;
  args.voxel_counts[tile] = voxels;
}

// Voxel index of a cell of the brick with index `element` in the slot table.
__device__ inline uint32_t VoxelOfCell(const PoolResultArgs& args, uint32_t element, uint32_t cell) {
  const uint32_t tile = element / 4, tiles_x = args.pool.tiles_x, tiles_y = args.pool.tiles_y;
  const uint32_t x = (tile % tiles_x * 4 + element % 4) * 8 + cell % 8, y = tile / tiles_x % tiles_y * 8 + cell / 8 % 8;
  return x + args.nx * (y + args.ny * (tile / tiles_x / tiles_y * 8 + cell / 64));
}

// Stores the value of a cell as voxel n of the result.
__device__ inline void StoreKey(const PoolResultArgs& args, uint32_t element, uint32_t cell, uint64_t n, uint32_t key) {
  if (args.owners != nullptr) {
    args.owners[n] = (args.complement ? ~key : key) - 1;
    args.voxel_keys[n] = VoxelOfCell(args, element, cell);
    return;
  }
  const uint32_t stored = StoredBits(BitsOfKey(args.complement ? ~key : key), args.format);
  if (args.format == VoxelFormat::kF16) {
    reinterpret_cast<uint16_t*>(args.out)[n] = uint16_t(stored);
  } else {
    reinterpret_cast<uint32_t*>(args.out)[n] = stored;
  }
}

// Outputs bricks in the order of their ids, with the values or owners of their voxels. One warp per slot.
__global__ void __launch_bounds__(kPoolThreads) EmitPlaces(const __grid_constant__ PoolResultArgs args) {
  const uint32_t given = GivenPlaces(args.pool), lane = threadIdx.x % 32;
  for (uint32_t place = (blockIdx.x * kPoolThreads + threadIdx.x) / 32; place < given;
       place += gridDim.x * (kPoolThreads / 32)) {
    const uint32_t element = args.pool.bricks[place], tile = element / 4, part = element % 4;
    uint64_t brick = args.first_brick[tile], n = args.first_voxel[tile];
    for (uint32_t p = 0; p < part; ++p) {
      const uint32_t earlier = args.pool.places[tile * 4 + p];
      if (!IsPlace(earlier)) continue;
      ++brick;
      n += args.voxels[earlier - kFirstPlace];
    }
    if (lane == 0 && args.bricks != nullptr) {
      const uint64_t tiles_x = args.pool.tiles_x, tiles_y = args.pool.tiles_y;
      const uint64_t x = tile % tiles_x * 4 + part, y = tile / tiles_x % tiles_y, z = tile / tiles_x / tiles_y;
      args.bricks[brick] = x + args.bricks_x * (y + args.bricks_y * (z + args.first_layer));
    }
    const uint32_t word = lane < 16 ? args.masks[place * 16 + lane] : 0;
    if (lane < 16 && args.out_masks != nullptr) args.out_masks[brick * 16 + lane] = word;
    uint32_t total;
    const uint32_t before = WarpExclusiveSum(uint32_t(__popc(word)), total);
    const auto* const units = reinterpret_cast<const uint4*>(args.pool.cells + uint64_t{place} * kBrickCells);
#pragma unroll
    for (int i = 0; i < kUnitsOfLane; ++i) {
      const int at = i * 4 + int(lane / 8);
      const uint32_t bits = __shfl_sync(~0u, word, at), first = __shfl_sync(~0u, before, at);
      const uint32_t shift = 4 * (lane % 8), mine = bits >> shift & 15;
      if (mine == 0) continue;
      const uint4 four = units[uint32_t(i) * 32 + lane];
      uint64_t to = n + first + uint32_t(__popc(bits & ((1u << shift) - 1)));
      const uint32_t cell = 128 * uint32_t(i) + 4 * lane;
      if ((mine & 1) != 0) StoreKey(args, element, cell, to++, four.x);
      if ((mine & 2) != 0) StoreKey(args, element, cell + 1, to++, four.y);
      if ((mine & 4) != 0) StoreKey(args, element, cell + 2, to++, four.z);
      if ((mine & 8) != 0) StoreKey(args, element, cell + 3, to++, four.w);
    }
  }
}

}  // namespace voxelpipe::cuda
