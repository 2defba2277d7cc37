// Many triangles in random order: ordered by place first, the largest apart. For plain bits and for blending without tiles.
//
// Where a grid is larger than the L2 cache (plain bits: many times larger), an atomic on a word that is not there takes six times as long. Triangles of one coarse cell
// of the grid after the other keep to few words at a time. Two passes of a counting sort: KeyTriangles tells each triangle's cell and
// counts, its last block adds the counts up; PlaceTriangles writes the order. The largest triangles are not ordered but listed: those that
// have a place in Large are drawn by pieces (bit_pieces.cuh), the others by WalkLarge; blended ones by EmitLarge (span_kernels.cuh), or where
// targets are written by rows (row_parts.cuh).
// No host-only includes.
#pragma once

#include "cuda/bit_bins.cuh"
#include "cuda/bit_walk.cuh"

namespace voxelpipe::cuda {

inline constexpr int kOrderThreads = 512, kOrderRounds = 8;
inline constexpr uint32_t kOrderChunk = kOrderThreads * kOrderRounds;  // triangles of a block
inline constexpr int kCellsOfSide = 16;                                // coarse cells along each axis
inline constexpr uint32_t kOrderCells = kCellsOfSide * kCellsOfSide * kCellsOfSide;
inline constexpr uint32_t kNoCell = ~0u;  // of a triangle that is not ordered

struct OrderArgs {
  uint32_t* keys = nullptr;  // of every triangle
  uint32_t* cells =
      nullptr;  // kOrderCells and two: counts, then where each begins; how many are ordered; blocks that are done
  uint32_t* order = nullptr;     // room for all triangles
  int shift[3] = {0, 0, 0};      // of a voxel's coordinates to its cell's
  bool blends = false;           // the largest are then those that EmitRest would pass on to EmitLarge
  SharedSetup* large = nullptr;  // of the first kMostLarge of the large queue
};
__device__ inline uint32_t& OrderedCount(const OrderArgs& order) {
  return order.cells[kOrderCells];
}

struct OrderRoom {
  uint32_t counts[kOrderCells];
  StagedCorners staged[kOrderThreads / 32];
  bool last;
};

// Sums before each cell, by one block.
__device__ inline void SumCells(const OrderArgs& order, uint32_t* room) {
  constexpr uint32_t kEach = kOrderCells / kOrderThreads;
  uint32_t counts[kEach], sum = 0;
  for (uint32_t i = 0; i < kEach; ++i) {
    counts[i] = sum;
    sum += __ldcg(order.cells + threadIdx.x * kEach + i);
  }
  uint32_t total;
  const uint32_t before = WarpExclusiveSum(sum, total);
  const unsigned warp = threadIdx.x / 32;
  __syncthreads();
  if (threadIdx.x % 32 == 0) room[warp] = total;
  __syncthreads();
  uint32_t begins = before;
  for (unsigned w = 0; w < warp; ++w) begins += room[w];
  for (uint32_t i = 0; i < kEach; ++i) order.cells[threadIdx.x * kEach + i] = begins + counts[i];
  if (threadIdx.x == kOrderThreads - 1) OrderedCount(order) = begins + sum;
}

// The first pass. The cells' counts and the queues are 0 before. Waits for earlier kernels.
template <bool kPacked>
__device__ inline void KeyTriangles(const BitArgs& args, const OrderArgs& order, OrderRoom& shared) {
  uint32_t* const room = shared.counts;
  for (uint32_t i = threadIdx.x; i < kOrderCells; i += kOrderThreads) room[i] = 0;
  __syncthreads();
  AwaitEarlier();
  const uint64_t begin = uint64_t(blockIdx.x) * kOrderChunk + threadIdx.x;
  StagedCorners& staged = shared.staged[threadIdx.x / 32];
  if (begin < args.triangle_count) StageCorners<kPacked>(args, uint32_t(begin), staged);
  for (int round = 0; round < kOrderRounds; ++round) {
    const uint64_t t = begin + uint64_t(round) * kOrderThreads, then = t + kOrderThreads;
    if (t >= args.triangle_count) break;
    const Fetched<kPacked> fetched = TakeStaged<kPacked>(uint32_t(t), staged);
    if (round + 1 < kOrderRounds && then < args.triangle_count) StageCorners<kPacked>(args, uint32_t(then), staged);
    const FixedCorners v = LoadFixed<kPacked>(args, fetched);
    const FixedBox box = BoxOf(v.at, args.fixed);
    int from[3], upto[3];
    ClipBox(args, box, from, upto);
    const int unsure = box.doubtful ? 1 : 0;
    uint32_t key = kNoCell;
    if (upto[0] - from[0] + unsure > 0 && upto[1] - from[1] + unsure > 0 && upto[2] - from[2] + unsure > 0) {
      const int width = max(1, upto[1] - from[1]), layers = max(1, upto[2] - from[2]);
      if (order.blends ? uint64_t(uint32_t(width)) * uint32_t(layers) > kRowsOfWarp
                       : QueueOf(width, layers) == CellFate::kLarge) {
        args.large_queue[atomicAdd(reinterpret_cast<unsigned long long*>(args.queued + kLargeQueue), 1ull)] =
            uint32_t(t);
      } else {
        int cell[3];
        from[2] -= int(args.grid.slab_begin);
        for (int a = 0; a < 3; ++a) cell[a] = min(max(from[a], 0) >> order.shift[a], kCellsOfSide - 1);
        key = uint32_t(cell[0] + kCellsOfSide * (cell[1] + kCellsOfSide * cell[2]));
        atomicAdd(room + key, 1u);
      }
    }
    order.keys[t] = key;
  }
  __syncthreads();
  for (uint32_t i = threadIdx.x; i < kOrderCells; i += kOrderThreads) {
    if (room[i] != 0) atomicAdd(order.cells + i, room[i]);
  }
  __syncthreads();
  if (threadIdx.x == 0) {
    __threadfence();
    shared.last = atomicAdd(order.cells + kOrderCells + 1, 1u) == gridDim.x - 1;
  }
  __syncthreads();
  if (!shared.last) return;
  __threadfence();
  SumCells(order, room);
}

// The second. Where a cell begins moves on by what is placed there. Waits for earlier kernels, and only then lets the next begin: SetUpKernel
// reads what those wrote (bit_kernels.cuh).
__device__ inline void PlaceTriangles(const BitArgs& args, const OrderArgs& order, OrderRoom& shared) {
  uint32_t* const room = shared.counts;
  for (uint32_t i = threadIdx.x; i < kOrderCells; i += kOrderThreads) room[i] = 0;
  __syncthreads();
  AwaitEarlier();
  AllowNext();
  const uint64_t begin = uint64_t(blockIdx.x) * kOrderChunk + threadIdx.x;
  uint32_t keys[kOrderRounds], places[kOrderRounds];
#pragma unroll
  for (int round = 0; round < kOrderRounds; ++round) {
    const uint64_t t = begin + uint64_t(round) * kOrderThreads;
    keys[round] = t < args.triangle_count ? __ldcg(order.keys + t) : kNoCell;
  }
#pragma unroll
  for (int round = 0; round < kOrderRounds; ++round) {
    places[round] = keys[round] == kNoCell ? 0 : atomicAdd(room + keys[round], 1u);
  }
  __syncthreads();
  for (uint32_t i = threadIdx.x; i < kOrderCells; i += kOrderThreads) {
    if (room[i] != 0) room[i] = atomicAdd(order.cells + i, room[i]);
  }
  __syncthreads();
#pragma unroll
  for (int round = 0; round < kOrderRounds; ++round) {
    if (keys[round] == kNoCell) continue;
    order.order[room[keys[round]] + places[round]] = uint32_t(begin + uint64_t(round) * kOrderThreads);
  }
}

// Sets up number i of the largest triangles, where there are so many.
__device__ inline void SetUpLarge(const BitArgs& args, const OrderArgs& order, uint64_t i) {
  if (i >= min(__ldcg(args.queued + kLargeQueue), uint64_t{kMostLarge})) return;
  SharedSetup& s = order.large[i];
  if (SetUpRows(args, __ldcg(args.large_queue + i), s) == 0) s.begin[2] = s.end[2] = 0;
}

}  // namespace voxelpipe::cuda
