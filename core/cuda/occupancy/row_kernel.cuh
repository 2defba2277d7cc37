// Occupancy bits for meshes in which many triangles reach over more than two voxels: one thread per triangle, by rows
// (small_triangle_rows.h), even if its box is small.
//
// WalkCells (small_triangles.cuh) first sorts a block's triangles by class, so that lanes of a warp do the same work.
// If many triangles need rows, that costs more than it saves: they are loaded twice, and warps wait for each other. The
// atomics on the grid then limit the speed, so in grids larger than the cache each warp combines its bits first
// (warp_bit_tile.cuh). No host-only includes.
#pragma once

#include "cuda/traversal/small_triangles.cuh"
#include "cuda/traversal/warp_bit_tile.cuh"

namespace voxelpipe::cuda {

// Shared memory of a block. kTogether: with a bit tile for each warp.
template <bool kTogether>
struct RowRoom {
  CellSpan table[kMaxCells][kCellThreads];
};
template <>
struct RowRoom<true> : RowRoom<false> {
  RowBox boxes[kCellThreads / 32];
};

// Appends t to a queue if `wanted`. All threads of a warp call it.
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

// Writes the rows of a triangle (interface of VisitCells) to the warp's bit tile, or to the grid if they do not fit.
class RowsTogether {
 public:
  // `begin`, `first`: as in NearWords.
  __device__ RowsTogether(const BitArgs& args, const RowPlace& place, RowBox& box, const int (&begin)[3], int first)
      : args_(args), place_(place), box_(box), begin_(begin), first_(first), first_row_(place.RowOf(begin)) {}

  __device__ void Layer(int z) {
    z_ = z;
    row_ = first_row_ + uint32_t(z * place_.pitch);
  }
  __device__ void Row(int y, int x, int count) const {
    if (place_.fits()) {
      atomicOr(&box_.rows[row_ + uint32_t(y)], BitsFrom(uint32_t(first_ - place_.x + x), count));
      return;
    }
    NearWords words(args_, begin_, first_);
    words.Layer(z_);
    words.Row(y, x, count);
  }

 private:
  const BitArgs& args_;
  const RowPlace& place_;
  RowBox& box_;
  const int (&begin_)[3];
  int first_;
  uint32_t first_row_, row_ = 0;
  int z_ = 0;
};

// Rasterizes triangle i, if it exists. All threads of a block call it. Waits until the grid is cleared.
template <bool kThin, bool kPacked, bool kTogether>
__device__ inline void WalkByRows(const BitArgs& args, uint64_t i, RowRoom<kTogether>& room) {
  // Threads past the last triangle load it too and then discard it.
  const uint32_t at = min(uint32_t(i), uint32_t(args.triangle_count) - 1);
  const uint32_t t = kPacked ? args.packed[3 * uint64_t{at}].triangle : at;
  if constexpr (kTogether) ClearRows(room.boxes[threadIdx.x / 32]);
  FixedTriangle triangle;
  triangle.v = LoadFixed<kPacked>(args, at);
  triangle.box = BoxOf(triangle.v.at, args.fixed);
  const FixedBox& box = triangle.box;
  int begin[3], end[3];
  ClipBox(args, box, begin, end);
  const int greatest = max(box.last[0] - box.first[0], max(box.last[1] - box.first[1], box.last[2] - box.first[2]));
  const bool taken = i < args.triangle_count && !IsOutside(box, begin, end);
  CellFate fate = taken ? FateByRows(box, greatest, begin, end) : CellFate::kDone;
  __syncwarp();
  const bool walks = fate == CellFate::kRows;
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
      certain = WalkRows<kThin>(args, triangle, begin, end, table, 0, 1,
                                RowsTogether(args, place, room.boxes[threadIdx.x / 32], begin, box.first[0]));
    } else {
      certain = WalkRows<kThin>(args, triangle, begin, end, table, 0, 1, NearWords(args, begin, box.first[0]));
    }
    fate = certain ? CellFate::kDone : CellFate::kLayers;
  }
  if (fate == CellFate::kLarge && IsAmongLargest(args, t)) fate = CellFate::kDone;
  AwaitEarlier();
  __syncwarp();
  if constexpr (kTogether) {
    if (place.fits()) StoreRows(args, room.boxes[threadIdx.x / 32]);
  }
  AppendToQueue(args, kLayerQueue, fate == CellFate::kLayers, t);
  AppendToQueue(args, kLargeQueue, fate == CellFate::kLarge, t);
}

}  // namespace voxelpipe::cuda
