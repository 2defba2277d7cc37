// Occupancy bits of so few triangles that all blocks are resident, with one thread per triangle or half of one: the
// steps of small_triangles.cuh tuned for latency. Corners are kept in shared memory for the second step. No host-only
// includes.
#pragma once

#include "cuda/traversal/small_triangles.cuh"

namespace voxelpipe::cuda {

// Shared memory of a block in WalkFew.
template <int kRowLanes>
struct FewRoom : CellLists<kCellThreads / kRowLanes> {
  CellSpan table[kMaxCells][kCellThreads];
  int corners[9][FewRoom::kRoom];  // of the triangles in `cells`

  __device__ void Keep(uint32_t number, const FixedCorners& v) {
    for (int i = 0; i < 9; ++i) corners[i][number] = v.at[i / 3][i % 3];
  }
  __device__ FixedTriangle Kept(uint32_t number, const FixedPlace& place) const {
    FixedTriangle t;
    for (int i = 0; i < 9; ++i) t.v.at[i / 3][i % 3] = corners[i][number];
    t.box = BoxOf(t.v.at, place);
    return t;
  }
  // Defers an uncertain triangle to the next kernel.
  __device__ void PassOn(uint32_t number) { this->later[SharedAdd(&this->layer_count, 1)] = uint16_t(number); }
};

// Processes part at % kRowLanes of the rows of a listed triangle. Returns true to one lane of each triangle for which
// the filter is uncertain. All threads of a warp call it.
template <bool kThin, int kRowLanes>
__device__ inline bool TakeFewRows(const BitArgs& args, uint32_t at, FewRoom<kRowLanes>& room, uint32_t& number) {
  const uint32_t i = at / kRowLanes, part = at % kRowLanes;
  bool doubtful = false;
  if (i < room.row_count) {
    number = room.RowNumber(i);
    const FixedTriangle t = room.Kept(number, args.fixed);
    int begin[3], end[3];
    ClipBox(args, t.box, begin, end);
    doubtful = !WalkRows<kThin>(args, t, begin, end, &room.table[0][threadIdx.x], int(part), kRowLanes,
                                NearWords(args, begin, t.box.first[0]));
  }
  __syncwarp();
  for (int step = 1; step < kRowLanes; step *= 2) doubtful |= __shfl_xor_sync(~0u, int(doubtful), step) != 0;
  return doubtful && part == 0;
}

// Processes the i-th of the triangles that need 2x2x2 tests. All threads of a warp call it.
template <bool kThin, int kRowLanes>
__device__ inline bool TakeFewOctants(const BitArgs& args, uint32_t i, const FewRoom<kRowLanes>& room,
                                      uint32_t& number) {
  bool doubtful = false;
  uint32_t octants = 0;
  FixedTriangle t{};
  if (i < room.octant_count) {
    number = room.cells[i];
    t = room.Kept(number, args.fixed);
    doubtful = !FindOctants<kThin>(args, t, octants);
  }
  __syncwarp();
  SetOctantsTogether(args, t.box.first, octants);
  return doubtful;
}

// True if one thread can process the rows of the box.
__device__ inline bool HasFewRows(const FixedBox& box) {
  const int width = box.last[1] - box.first[1] + 1, layers = box.last[2] - box.first[2] + 1;
  return max(width, layers) <= kMaxCellRows && width * layers <= kMaxCellRows;
}

// Like WalkCells, for the triangles of block `chunk`, as many as the shared memory holds.
template <bool kThin, int kRowLanes>
__device__ inline void WalkFew(const BitArgs& args, uint32_t chunk, FewRoom<kRowLanes>& room) {
  constexpr uint32_t kEach = FewRoom<kRowLanes>::kRoom;
  const uint32_t begin = chunk * kEach, mine = threadIdx.x;
  const bool has = mine < min(uint32_t(args.triangle_count) - begin, kEach);
  Fetched<false> fetched{};
  if (has) fetched = FetchNow<false>(args, begin + mine);
  if (threadIdx.x == 0) {
    room.Clear();
  }
  __syncthreads();
  FixedTriangle triangle{};
  uint32_t octants = 0;
  CellFate fate = FindFirst<kThin>(
      args, has, fetched, [&] { return begin + mine; }, triangle, octants);
  octants = Together(triangle.box.first, octants);
  if (fate == CellFate::kRows || fate == CellFate::kOctants) room.Keep(mine, triangle.v);
  if (fate == CellFate::kLarge && IsAmongLargest(args, begin + mine)) fate = CellFate::kDone;
  const bool in_doubt = fate == CellFate::kLayers && GoesByFixed(args) && HasFewRows(triangle.box);
  if (in_doubt) fate = CellFate::kDone;
  __syncwarp();
  room.Append(fate, mine);
  AwaitCleared(args);                           // only shared memory is written before
  if (args.clear_blocks == 0) __syncthreads();  // AwaitCleared was no barrier then, and the lists are read below
  if (in_doubt) room.PassOn(mine);
  if (octants != 0) SetOctants(args, triangle.box.first, octants);
  __syncwarp();
  TakeTurns(
      room.turn, room.row_count * kRowLanes, room.octant_count,
      [&](uint32_t at, uint32_t& number) { return TakeFewRows<kThin>(args, at, room, number); },
      [&](uint32_t i, uint32_t& number) { return TakeFewOctants<kThin>(args, i, room, number); },
      [&](bool uncertain, uint32_t number) {
        if (uncertain) room.PassOn(number);
        __syncwarp();
      });
  __syncthreads();
  if (room.layer_count + room.large_count == 0) return;
  QueueLater<false>(args, room, [begin](uint32_t number) { return begin + number; });
}

}  // namespace voxelpipe::cuda
