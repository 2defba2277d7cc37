// Plain bits of meshes many of whose triangles reach over more than two voxels: a triangle a thread, by rows (bit_cells.cuh), however small its box.
//
// WalkCells (bit_walk.cuh) sorts a block's triangles first, so that lanes of a warp do the same. Where many of them go by rows, that takes longer
// than it saves: they are read twice, and warps wait for each other. What is left then is the rate of atomics on the grid, so those of
// a warp are brought together (row_box.cuh) in grids larger than the cache. No host-only includes.
#pragma once

#include "cuda/bit_walk.cuh"
#include "cuda/row_box.cuh"

namespace voxelpipe::cuda {

// Of a block. kTogether: with a box for each warp.
template <bool kTogether>
struct RowRoom {
  CellSpan table[kMostCells][kCellThreads];
};
template <>
struct RowRoom<true> : RowRoom<false> {
  RowBox boxes[kCellThreads / 32];
};

// Appends t to a queue where `wanted`. All threads of a warp call it.
__device__ inline void AppendToQueue(const BitArgs& args, BitQueue queue, bool wanted, uint32_t t) {
  const unsigned lane = threadIdx.x % 32, all = __ballot_sync(~0u, wanted);
  if (all == 0) return;
  unsigned long long at = 0;
  if (lane == 0) {
    at = atomicAdd(reinterpret_cast<unsigned long long*>(args.queued + queue), 0ull + uint32_t(__popc(all)));
  }
  at = __shfl_sync(~0u, at, 0) + uint32_t(__popc(all & ((1u << lane) - 1)));
  if (wanted) (queue == kLayerQueue ? args.layer_queue : args.large_queue)[at] = t;
}

// Triangle i of the walk, if there are so many. All threads of a block call it. Waits for whoever clears the grid.
template <bool kThin, bool kPacked, bool kTogether>
__device__ inline void WalkByRows(const BitArgs& args, uint64_t i, RowRoom<kTogether>& room) {
  FixedTriangle triangle{};
  CellFate fate = CellFate::kDone;
  uint32_t t = uint32_t(i), octants = 0;
  int begin[3] = {}, end[3] = {};
  if constexpr (kTogether) ClearRows(room.boxes[threadIdx.x / 32]);
  if (i < args.triangle_count) {
    // As under thin coverage, where a box alone decides no voxel.
    fate = FindFate</*kThin=*/true>(args, FetchNow<kPacked>(args, uint32_t(i)), triangle, octants);
    ClipBox(args, triangle.box, begin, end);
    if constexpr (kPacked) t = args.packed[3 * i].triangle;
  }
  __syncwarp();
  const bool walks = fate == CellFate::kRuns || fate == CellFate::kOctants || fate == CellFate::kRows;
  RowPlace place;
  if constexpr (kTogether) {
    place = FitRows(room.boxes[threadIdx.x / 32], walks, begin, end);
    __syncwarp();
  }
  if (!place.fits()) AwaitEarlier();
  if (walks) {
    CellSpan* const table = &room.table[0][threadIdx.x];
    bool certain = false;
    if constexpr (kTogether) {
      RowBox& box = room.boxes[threadIdx.x / 32];
      const uint32_t first_row = place.RowOf(begin), first_x = uint32_t(begin[0] - place.x);
      certain = WalkRows<kThin>(args, triangle, begin, end, table, 0, 1, [&](int y, int z, int x, int count) {
        if (place.fits()) {
          place.Set(box, first_row, y, z, first_x + uint32_t(x), count);
        } else {
          NearWords(args, begin).SetFew(y, z, x, count);
        }
      });
    } else {
      const NearWords words(args, begin);
      certain = WalkRows<kThin>(args, triangle, begin, end, table, 0, 1,
                                [&](int y, int z, int x, int count) { words.SetFew(y, z, x, count); });
    }
    fate = certain ? CellFate::kDone : CellFate::kLayers;
  }
  AwaitEarlier();
  __syncwarp();
  if constexpr (kTogether) {
    if (place.fits()) StoreRows(args, room.boxes[threadIdx.x / 32]);
  }
  AppendToQueue(args, kLayerQueue, fate == CellFate::kLayers, t);
  AppendToQueue(args, kLargeQueue, fate == CellFate::kLarge, t);
}

}  // namespace voxelpipe::cuda
