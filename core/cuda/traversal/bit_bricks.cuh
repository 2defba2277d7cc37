// Occupancy bits in grids larger than the L2 cache: bits are set in bricks of 32x8x8 voxels, which are allocated on
// demand (brick_allocator.cuh) and fit in the cache. Then every word of the grid is written once, in order. Otherwise
// each atomic on an uncached word would read its sector from memory, although it was just cleared. No host-only
// includes.
#pragma once

#include "cuda/primitives/brick_allocator.cuh"
#include "cuda/traversal/raster_args.cuh"

namespace voxelpipe::cuda {

// Sets rows of the slab in bricks. Word y + 8*z of a brick has the 32 voxels of that row.
class PoolRows {
 public:
  __device__ explicit PoolRows(const BitArgs& args) : args_(args) {}

  // Sets the voxels of a mask: its low half in word `word` of a row, its high half in the next word.
  __device__ void SetMask(int word, int y, int z, uint64_t mask) {
    z -= int(args_.grid.slab_begin);
    const BitPool& pool = args_.pool;
    const uint32_t brick = uint32_t(word) + pool.dims_x * (uint32_t(y >> 3) + pool.dims_y * uint32_t(z >> 3));
    const uint32_t row = uint32_t(y & 7) | uint32_t(z & 7) << 3;
    if (uint32_t(mask) != 0) {
      if (brick != brick_) {
        brick_ = brick;
        words_ = WordsOf(brick);
      }
      ReduceOr(words_ + row, uint32_t(mask));
    }
    if (uint32_t(mask >> 32) != 0) ReduceOr(WordsOf(brick + 1) + row, uint32_t(mask >> 32));
  }
  // Sets at most kMaxCells voxels of a row.
  __device__ void SetFew(int y, int z, int x_begin, int x_end) {
    SetMask(x_begin >> 5, y, z, uint64_t{(1u << (x_end - x_begin)) - 1} << (x_begin & 31));
  }
  // Sets the voxels of a 2x2x2 mask that is clipped to the grid.
  __device__ void SetOctants(const int (&first)[3], uint32_t octants) {
    ForEachPair(first, octants, [&](int word, int y, int z, uint64_t mask) { SetMask(word, y, z, mask); });
  }

 private:
  const BitArgs& args_;
  uint32_t brick_ = ~0u;
  uint32_t* words_ = nullptr;

  __device__ uint32_t* WordsOf(uint32_t brick) const {
    uint32_t place = __ldca(args_.pool.places + brick);
    // Another multiprocessor may have allocated it since.
    if (!IsPlace(place)) place = LoadAcquire(args_.pool.places + brick);
    if (!IsPlace(place)) place = TakePlace(args_.pool, brick);
    return args_.pool.WordsOf(place - kFirstPlace);
  }
};

inline constexpr uint32_t kPartWords = 64, kPartRows = 8;  // tile of a layer that a warp stores: words along x, rows

// A tile by its number; consecutive tiles are adjacent in memory.
struct PoolPart {
  uint32_t x, y, z;  // z in layers, x and y in tiles

  __device__ PoolPart(const BitArgs& args, uint32_t number) {
    const uint32_t along_x = (args.pool.dims_x + kPartWords - 1) / kPartWords, yz = number / along_x;
    x = number - yz * along_x;
    z = yz / args.pool.dims_y;
    y = yz - z * args.pool.dims_y;
  }
};
inline uint64_t PartsOf(const BitArgs& args) {
  const uint64_t along_x = (args.pool.dims_x + kPartWords - 1) / kPartWords;
  return along_x * args.pool.dims_y * uint64_t(args.grid.slab_end - args.grid.slab_begin);
}

// Shared memory to transpose a tile's words from bricks to rows.
struct PartRoom {
  alignas(16) uint32_t words[kPartRows * kPartWords];
};

// Writes a tile of the grid, from bricks or zeros where none is allocated, by one warp. kQuads: rows are a multiple of
// 16 bytes.
template <bool kQuads>
__device__ inline void StorePart(const BitArgs& args, const PoolPart& part, PartRoom& room) {
  constexpr uint32_t kBricks = kPartWords / 32;  // per lane
  const BitPool& pool = args.pool;
  const uint32_t lane = threadIdx.x % 32, ny = uint32_t(args.grid.dims[1]), first = part.x * kPartWords;
  const uint32_t words = min(kPartWords, pool.dims_x - first), rows = min(kPartRows, ny - part.y * kPartRows);
  const uint32_t* const from = pool.places + (uint64_t{part.z / 8} * pool.dims_y + part.y) * pool.dims_x + first;
  uint32_t* const to = args.bits + (uint64_t{ny} * part.z + part.y * kPartRows) * pool.dims_x + first;
  uint32_t places[kBricks];
  bool mine = false;
#pragma unroll
  for (uint32_t i = 0; i < kBricks; ++i) {
    // Bypasses the L1 cache, whose entries may be older than the allocation.
    places[i] = lane + i * 32 < words ? __ldcg(from + lane + i * 32) : kNoPlace;
    mine = mine || IsPlace(places[i]);
  }
  const bool any = __any_sync(~0u, mine) != 0;
  if (any || !kQuads) {
#pragma unroll
    for (uint32_t i = 0; i < kBricks; ++i) {
      uint4 near{}, far{};  // rows 0 to 3 and 4 to 7 of the brick's layer
      if (IsPlace(places[i])) {
        const auto* const layer =
            reinterpret_cast<const uint4*>(pool.WordsOf(places[i] - kFirstPlace) + part.z % 8 * 8);
        near = __ldcg(layer);
        far = __ldcg(layer + 1);
      }
      const uint32_t column[kPartRows] = {near.x, near.y, near.z, near.w, far.x, far.y, far.z, far.w};
      const uint32_t at = lane + i * 32;
#pragma unroll
      for (uint32_t row = 0; row < kPartRows; ++row) {
        if constexpr (kQuads) {
          room.words[row * kPartWords + at] = column[row];
        } else {
          if (row < rows && at < words) to[uint64_t{row} * pool.dims_x + at] = column[row];
        }
      }
    }
    __syncwarp();
  }
  if constexpr (kQuads) {
    constexpr uint32_t kUnits = kPartWords / 4;
    const uint32_t at = lane % kUnits * 4;
#pragma unroll
    for (uint32_t row = lane / kUnits; row < kPartRows; row += 32 / kUnits) {
      if (row >= rows || at >= words) continue;
      uint4 four{};
      if (any) four = *reinterpret_cast<const uint4*>(room.words + row * kPartWords + at);
      *reinterpret_cast<uint4*>(to + uint64_t{row} * pool.dims_x + at) = four;
    }
  }
}

}  // namespace voxelpipe::cuda
