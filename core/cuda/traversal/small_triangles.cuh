// Occupancy bits of one grid: rasterizes small triangles from world space directly into the words of the bit grid.
//
// Two steps, each a kernel or a part of one. First, WalkCells (here): one thread per triangle; the voxels that the
// floating-point filter is certain of (small_triangle_tests.h) are set at once. Second, large_triangles.cuh: the
// remaining triangles, deferred in two queues.
//
// Variants: unordered meshes are processed in Morton order (mesh_locality.h), and their largest triangles are drawn
// while the grid is cleared (block_raster.cuh). Few large triangles in large grids: block_bins.cuh. Fine meshes in
// large grids: the first step sets bits in bricks, which are copied to the grid before the second step
// (bit_bricks.cuh). Other first steps: row_kernel.cuh if many triangles touch several voxels, resident_mesh.cuh if
// there are few triangles. No host-only includes.
#pragma once

#include "cuda/primitives/acquire_release.cuh"
#include "cuda/primitives/dependent_launch.cuh"
#include "cuda/traversal/bit_bricks.cuh"
#include "cuda/traversal/bit_writes.cuh"
#include "cuda/traversal/corner_fetch.cuh"
#include "cuda/traversal/raster_args.cuh"
#include "cuda/traversal/warp_bit_tile.cuh"
#include "raster/filtered/small_triangle_rows.h"

namespace voxelpipe::cuda {

inline constexpr int kCellThreads = 128;
inline constexpr int kMaxCellRows = 64;  // limit for a triangle that one thread processes alone
// Lanes of a warp with 2x2x2 work that make it worth doing at once.
inline constexpr int kManyOctants = 14;
inline constexpr int kMaxCellRounds = 8;                         // triangles per thread of WalkCells
inline constexpr int kMaxLayerWidth = 96, kMaxLayerRows = 6144;  // limits of WalkLayers: rows along y, and in all

// Where bits are set: in words of the grid individually; in words of the grid, with 2x2x2 masks combined per warp
// (warp_bit_tile.cuh); in bricks (bit_bricks.cuh).
enum class BitSink { kWords, kTogether, kBricks };

// The class of a triangle: done; a run, for thin coverage (box of one voxel or two adjacent ones); decided as a 2x2x2
// mask; by rows; deferred to the layer queue or the large queue.
enum class CellFate { kDone, kRuns, kOctants, kRows, kLayers, kLarge };

// True if the triangle needs more than a 2x2x2 test.
__device__ inline bool WaitsForRows(CellFate fate) {
  return fate == CellFate::kRows || fate == CellFate::kLayers || fate == CellFate::kLarge;
}

// The queue for a triangle of this size.
__device__ inline CellFate QueueOf(int64_t width, int64_t layers) {
  return width > kMaxLayerWidth || width * layers > kMaxLayerRows ? CellFate::kLarge : CellFate::kLayers;
}

// Clips a box to the slab; empty if end <= begin along some axis.
__device__ inline void ClipBox(const BitArgs& args, const FixedBox& box, int (&begin)[3], int (&end)[3]) {
  const int low[3] = {0, 0, int(args.grid.slab_begin)};
  const int high[3] = {int(args.grid.dims[0]), int(args.grid.dims[1]), int(args.grid.slab_end)};
  for (int a = 0; a < 3; ++a) {
    begin[a] = max(box.first[a], low[a]);
    end[a] = min(box.last[a] + 1, high[a]);
  }
}

struct FixedTriangle {
  FixedCorners v;
  FixedBox box;
};

// True if no voxel of a box is in the slab. `begin`, `end`: the clipped box.
__device__ inline bool IsOutside(const FixedBox& box, const int (&begin)[3], const int (&end)[3]) {
  const int unsure = box.doubtful ? 1 : 0;
  return end[0] - begin[0] + unsure <= 0 || end[1] - begin[1] + unsure <= 0 || end[2] - begin[2] + unsure <= 0;
}

// The class of a triangle larger than 2x2x2 voxels: by rows or deferred. `greatest`: maximum extent of its box along an
// axis, in voxels, minus 1.
__device__ inline CellFate FateByRows(const FixedBox& box, int greatest, const int (&begin)[3], const int (&end)[3]) {
  const int width = max(1, end[1] - begin[1]), layers = max(1, end[2] - begin[2]);
  if (!box.doubtful && greatest < kMaxCells && width * layers <= kMaxCellRows) return CellFate::kRows;
  return QueueOf(width, layers);
}

// The 2x2x2 mask of a box of at most two voxels along each axis.
__device__ inline uint32_t OctantsOf(const FixedBox& box) {
  const auto far = [&box](int a, uint32_t near) { return near + uint32_t(box.last[a] - box.first[a]) * (0xff - near); };
  return far(0, 0x55) & far(1, 0x33) & far(2, 0x0f);
}

// Computes the box of the triangle with corners `t` and classifies it by the box alone. For kDone, `octants` is the
// result.
template <bool kThin>
__device__ inline CellFate FindFate(const BitArgs& args, FixedTriangle& t, uint32_t& octants) {
  t.box = BoxOf(t.v.at, args.fixed);
  const FixedBox& box = t.box;
  int begin[3], end[3];
  ClipBox(args, box, begin, end);
  if (IsOutside(box, begin, end)) return CellFate::kDone;
  const int size[3] = {box.last[0] - box.first[0], box.last[1] - box.first[1], box.last[2] - box.first[2]};
  const int greatest = max(size[0], max(size[1], size[2]));
  if (!box.doubtful && greatest <= 1) {
    if (size[0] + size[1] + size[2] > 1) return CellFate::kOctants;
    if constexpr (!kThin) {  // the run class touches its whole box
      octants = size[0] != 0 ? 0x03 : size[1] != 0 ? 0x05 : size[2] != 0 ? 0x11 : 0x01;
      return CellFate::kDone;
    }
    return CellFate::kRuns;
  }
  return FateByRows(box, greatest, begin, end);
}
template <bool kThin, bool kPacked>
__device__ inline CellFate FindFate(const BitArgs& args, const Fetched<kPacked>& fetched, FixedTriangle& t,
                                    uint32_t& octants) {
  t.v = LoadFixed<kPacked>(args, fetched);
  return FindFate<kThin>(args, t, octants);
}

// Decides the runs of a warp; if they are few, reclassifies them as 2x2x2. All threads of a warp call it.
template <bool kThin>
__device__ inline void DecideRuns(const BitArgs& args, const FixedTriangle& t, CellFate& fate, uint32_t& octants) {
  if constexpr (kThin) {
    const bool run = fate == CellFate::kRuns;
    const int runs = __popc(__ballot_sync(~0u, run));
    if (run && runs < kManyOctants) fate = CellFate::kOctants;
    if (run && runs >= kManyOctants) {
      const Octants o = TouchedThinRun(t.v.at, t.box, args.fixed);
      if (!o.doubtful) octants = o.touched;
      fate = o.doubtful ? CellFate::kLayers : CellFate::kDone;
    }
    __syncwarp();
  }
}

// Decides a triangle of class kOctants. False if the filter is uncertain for some voxel.
template <bool kThin>
__device__ inline bool FindOctants(const BitArgs& args, const FixedTriangle& t, uint32_t& octants) {
  const Octants o = TouchedOctants<kThin>(t.v.at, t.box, OctantsOf(t.box), args.fixed);
  if (o.doubtful) return false;
  octants = o.touched;
  return true;
}

// Enumerates the rows of a triangle of at most kMaxCells voxels along each axis, as VisitCells. False if the filter is
// uncertain for some voxel. Processes layers part, part + parts, ...
template <bool kThin, typename Rows>
__device__ inline bool WalkRows(const BitArgs& args, const FixedTriangle& t, const int (&begin)[3], const int (&end)[3],
                                CellSpan* table, int part, int parts, Rows&& to) {
  const FixedBox& box = t.box;
  const int single = (box.first[0] == box.last[0]) + (box.first[1] == box.last[1]) + (box.first[2] == box.last[2]);
  const bool run = !kThin && single >= 2;  // the run class
  return VisitCells<kThin>(t.v.at, box, begin, end, args.fixed, table, kCellThreads, run, to, part, parts);
}

// Rasterizes a triangle of class kRows; the result is as above.
template <bool kThin, bool kPacked, BitSink kSink>
__device__ inline bool WalkCellRows(const BitArgs& args, const Fetched<kPacked>& fetched, CellSpan* table) {
  FixedTriangle t;
  t.v = LoadFixed<kPacked>(args, fetched);
  t.box = BoxOf(t.v.at, args.fixed);
  int begin[3], end[3];
  ClipBox(args, t.box, begin, end);
  if constexpr (kSink == BitSink::kBricks) {
    PoolRows rows(args);
    const auto set = [&](int y, int z, int x, int count) {
      rows.SetFew(begin[1] + y, begin[2] + z, t.box.first[0] + x, t.box.first[0] + x + count);
    };
    return WalkRows<kThin>(args, t, begin, end, table, 0, 1, EachRow(set));
  }
  return WalkRows<kThin>(args, t, begin, end, table, 0, 1, NearWords(args, begin, t.box.first[0]));
}

// Classifies a triangle without fixed-point coordinates: the mesh exceeds their range, or center coverage. Selects the
// queue only.
__device__ __noinline__ inline CellFate FindQueue(const BitArgs& args, uint64_t t) {
  const PlacedCorners p = PlaceCorners(args, uint32_t(t));
  int64_t width[3];
  for (int a = 1; a < 3; ++a) {
    const double least = Min(p.at[0][a], Min(p.at[1][a], p.at[2][a])),
                 most = Max(p.at[0][a], Max(p.at[1][a], p.at[2][a]));
    const double lo = a == 1 ? 0 : double(args.grid.slab_begin),
                 hi = a == 1 ? double(args.grid.dims[1]) : double(args.grid.slab_end);
    if (most < lo - 2 || least > hi + 2) return CellFate::kDone;
    width[a] = int64_t(Clamp(most + 2, lo, hi)) - int64_t(Clamp(least - 2, lo, hi));
  }
  return QueueOf(max(width[1], int64_t{1}), max(width[2], int64_t{1}));
}

// Appends t to a list of the block if `wanted`; `step` is 1 or -1. All threads of a warp call it.
template <typename Entry>
__device__ inline void AppendInBlock(bool wanted, uint32_t t, Entry* list, int step, uint32_t* count) {
  const unsigned lane = threadIdx.x % 32, all = __ballot_sync(~0u, wanted);
  if (all == 0) return;
  uint32_t at = 0;
  if (lane == 0) at = SharedAdd(count, uint32_t(__popc(all)));
  at = __shfl_sync(~0u, at, 0) + uint32_t(__popc(all & ((1u << lane) - 1)));
  if (wanted) list[int(at) * step] = Entry(t);
}

// Lists of a block's triangles that need more work, numbered from its first.
template <uint32_t kTriangles>
struct CellLists {
  static constexpr uint32_t kRoom = kTriangles;
  static_assert(kRoom <= 1 << 16);
  uint16_t cells[kRoom];  // for 2x2x2 tests from the front, for rows from the back
  uint16_t later[kRoom];  // for other kernels: layer queue from the front, large queue from the back
  uint32_t octant_count, row_count, layer_count, large_count;
  uint32_t turn;  // the next work item of a warp
  unsigned long long first_layer, first_large;

  __device__ void Clear() { octant_count = row_count = layer_count = large_count = turn = 0; }
  // Called by all threads of a warp with their own triangles.
  __device__ void Append(CellFate fate, uint32_t number) {
    AppendInBlock(fate == CellFate::kOctants, number, cells, 1, &octant_count);
    if (__any_sync(~0u, WaitsForRows(fate)) == 0) return;
    AppendInBlock(fate == CellFate::kRows, number, cells + (kRoom - 1), -1, &row_count);
    AppendInBlock(fate == CellFate::kLayers, number, later, 1, &layer_count);
    AppendInBlock(fate == CellFate::kLarge, number, later + (kRoom - 1), -1, &large_count);
  }
  __device__ uint32_t RowNumber(uint32_t i) const { return cells[kRoom - 1 - i]; }
  __device__ uint32_t LargeNumber(uint32_t i) const { return later[kRoom - 1 - i]; }
};

// Shared memory of each warp of a block during the first pass.
struct FirstPass {
  uint2 found[kCellThreads / 32][kMaxCellRounds * 32];  // 2x2x2 masks, set after the bits are cleared
  StagedCorners staged[kCellThreads / 32];
};
// Shared memory of a block in WalkCells.
struct CellRoom : CellLists<kMaxCellRounds * kCellThreads> {
  union {
    CellSpan table[kMaxCells][kCellThreads];
    FirstPass first_pass;
  };
};
// The same with a bit tile for each warp.
struct CellRoomTogether : CellRoom {
  OctantBox boxes[kCellThreads / 32];
};
template <BitSink kSink>
struct CellRoomType {
  using Type = CellRoom;
};
template <>
struct CellRoomType<BitSink::kTogether> {
  using Type = CellRoomTogether;
};
template <BitSink kSink>
using CellRoomFor = typename CellRoomType<kSink>::Type;

// Dynamic scheduling: takes the next work item of the block for this warp. All threads of a warp call it.
__device__ inline uint32_t NextTurn(uint32_t& turn) {
  uint32_t mine = 0;
  if (threadIdx.x % 32 == 0) mine = SharedAdd(&turn, 1u);
  return __shfl_sync(~0u, mine, 0);
}

// The second step of a block: shares its listed triangles among its warps, a lane each; rows first, since they take
// longest. take_rows(i, number) and take_octants(i, number) process the i-th listed triangle, if there is one, set its
// number in the block and return true if the filter is uncertain; defer(uncertain, number) keeps it for another kernel.
// All threads of a warp call each of them.
template <typename TakeRows, typename TakeOctants, typename Defer>
__device__ inline void TakeTurns(uint32_t& turn, uint32_t rows, uint32_t octants, TakeRows&& take_rows,
                                 TakeOctants&& take_octants, Defer&& defer) {
  const uint32_t row_turns = (rows + 31) / 32, turns = row_turns + (octants + 31) / 32, lane = threadIdx.x % 32;
  for (uint32_t next = NextTurn(turn); next < turns; next = NextTurn(turn)) {
    uint32_t number = 0;
    const bool uncertain =
        next < row_turns ? take_rows(next * 32 + lane, number) : take_octants((next - row_turns) * 32 + lane, number);
    defer(uncertain, number);
  }
}

// Packs a 2x2x2 mask and its first voxel into 64 bits; fixed-point voxel coordinates have 16 bits.
__device__ inline uint2 PackOctants(const int (&first)[3], uint32_t octants) {
  return {(uint32_t(first[0]) & 0xffff) | uint32_t(first[1]) << 16, (uint32_t(first[2]) & 0xffff) | octants << 16};
}
__device__ inline void SetPacked(const BitArgs& args, const uint2& packed) {
  const uint32_t octants = packed.y >> 16;
  if (octants == 0) return;
  const int first[3] = {int(int16_t(packed.x & 0xffff)), int(packed.x) >> 16, int(int16_t(packed.y & 0xffff))};
  SetOctants(args, first, octants);
}
// The same through the warp's bit tile; individually at the grid's borders. All threads of a warp call it.
__device__ inline void SetPackedTogether(const BitArgs& args, const uint2& packed, OctantBox& box) {
  const uint32_t octants = packed.y >> 16;
  const int first[3] = {int(int16_t(packed.x & 0xffff)), int(packed.x) >> 16, int(int16_t(packed.y & 0xffff))};
  const int low[3] = {0, 0, int(args.grid.slab_begin)};
  const int high[3] = {int(args.grid.dims[0]), int(args.grid.dims[1]), int(args.grid.slab_end)};
  bool inside = true;  // the usual case
  int end[3];
#pragma unroll
  for (int a = 0; a < 3; ++a) {
    inside = inside & (uint32_t(first[a] - low[a]) < uint32_t(high[a] - low[a] - 1));
    end[a] = first[a] + 2;
  }
  const bool has = octants != 0 && inside;
  const RowPlace place = FitRows(box, has, first, end);
  __syncwarp();
  if (octants != 0 && !(inside && place.fits())) SetOctants(args, first, octants);
  if (!place.fits()) return;
  if (has) {
    uint32_t* const rows = box.rows + place.RowOf(first);
    const int bit = first[0] - place.x;
#pragma unroll
    for (int i = 0; i < 4; ++i) {
      const uint32_t pair = octants >> 2 * i & 3;
      if (pair != 0) atomicOr(rows + ((i & 1) + ((i & 2) != 0 ? place.pitch : 0)), pair << bit);
    }
  }
  __syncwarp();
  StoreRows(args, box);
  __syncwarp();
}

// The same in bricks.
__device__ inline void SetPackedInPool(const BitArgs& args, const uint2& packed) {
  const int first[3] = {int(int16_t(packed.x & 0xffff)), int(packed.x) >> 16, int(int16_t(packed.y & 0xffff))};
  const uint32_t octants = ClipOctants(args, first, packed.y >> 16);
  if (octants != 0) PoolRows(args).SetOctants(first, octants);
}

// Waits until the grid and the queues are cleared. Acts as a barrier if blocks of this kernel clear. All threads of a
// block call it.
__device__ inline void AwaitCleared(const BitArgs& args) {
  if (args.clear_blocks == 0) return AwaitEarlier();
  if (threadIdx.x == 0) {
    while (LoadAcquire(args.cleared) < args.clear_blocks) {}
  }
  __syncthreads();
}

// Writes the 2x2x2 masks of a warp's lanes to the sink. All threads of a warp call it.
template <BitSink kSink>
__device__ inline void SetFound(const BitArgs& args, const uint2& packed, CellRoomFor<kSink>& room) {
  if constexpr (kSink == BitSink::kTogether) {
    SetPackedTogether(args, packed, room.boxes[threadIdx.x / 32]);
  } else if constexpr (kSink == BitSink::kBricks) {
    SetPackedInPool(args, packed);
  } else {
    SetPacked(args, packed);
  }
}
// Packs a mask when it is found. Without a bit tile, masks of adjacent lanes are combined here.
template <BitSink kSink>
__device__ inline uint2 PackFound(const int (&first)[3], uint32_t octants) {
  return PackOctants(first, kSink == BitSink::kTogether ? octants : Together(first, octants));
}

// Appends the non-empty masks of a warp's lanes to the `kept` masks in `found`. Returns their new number. All threads
// of a warp call it.
template <BitSink kSink>
__device__ inline uint32_t KeepFound(const int (&first)[3], uint32_t octants, uint2* found, uint32_t kept) {
  const uint2 packed = PackFound<kSink>(first, octants);
  const bool some = packed.y >> 16 != 0;
  const unsigned lane = threadIdx.x % 32, all = __ballot_sync(~0u, some);
  if (some) found[kept + uint32_t(__popc(all & ((1u << lane) - 1)))] = packed;
  return kept + uint32_t(__popc(all));
}

// True if triangles have fixed-point corners and boxes.
__device__ inline bool GoesByFixed(const BitArgs& args) {
  return args.fixed.bits > 0 && args.coverage != Coverage::kCenter;
}

// Classifies the lane's triangle, if it `has` one, by its box; if many lanes of the warp need 2x2x2 tests, does these
// too. `number` returns the triangle's number. All threads of a warp call it.
template <bool kThin, bool kPacked, typename Number>
__device__ inline CellFate FindFirst(const BitArgs& args, bool has, const Fetched<kPacked>& fetched, Number&& number,
                                     FixedTriangle& triangle, uint32_t& octants) {
  CellFate fate = CellFate::kDone;
  if (has) fate = GoesByFixed(args) ? FindFate<kThin>(args, fetched, triangle, octants) : FindQueue(args, number());
  __syncwarp();
  DecideRuns<kThin>(args, triangle, fate, octants);
  if (__popc(__ballot_sync(~0u, fate == CellFate::kOctants)) >= kManyOctants) {
    if (fate == CellFate::kOctants) {
      fate = FindOctants<kThin>(args, triangle, octants) ? CellFate::kDone : CellFate::kLayers;
    }
    __syncwarp();
  }
  return fate;
}

// Appends a block's deferred triangles to the queues, with one atomic per queue: an atomic that returns costs about 3
// ns under contention. number_at maps a number within the block to a triangle. All threads of a block call it.
template <bool kPrefetch, uint32_t kRoom, typename Number>
__device__ inline void QueueLater(const BitArgs& args, CellLists<kRoom>& lists, Number&& number_at) {
  auto* const queued = reinterpret_cast<unsigned long long*>(args.queued);
  if (threadIdx.x == 0 && lists.layer_count > 0) {
    lists.first_layer = atomicAdd(queued + kLayerQueue, 0ull + lists.layer_count);
  }
  if (threadIdx.x == 32 && lists.large_count > 0) {
    lists.first_large = atomicAdd(queued + kLargeQueue, 0ull + lists.large_count);
  }
  __syncthreads();
  for (uint32_t i = threadIdx.x; i < lists.layer_count; i += kCellThreads) {
    const uint32_t t = number_at(lists.later[i]);
    args.layer_queue[lists.first_layer + i] = t;
    if constexpr (kPrefetch) PrefetchCorners(args, t);
  }
  for (uint32_t i = threadIdx.x; i < lists.large_count; i += kCellThreads) {
    args.large_queue[lists.first_large + i] = number_at(lists.LargeNumber(i));
  }
}

// The first step of a block. Classifies triangles by their boxes first; then compacts those that need 2x2x2 tests or
// rows, so that lanes of a warp do the same work. Results of the first pass are held back until the grid is cleared, so
// that the pass overlaps the clearing. Waits until the grid is cleared.
template <bool kThin, bool kPacked, BitSink kSink>
__device__ inline void WalkCells(const BitArgs& args, uint64_t chunk, CellRoomFor<kSink>& room) {
  if (threadIdx.x == 0) room.Clear();
  if constexpr (kSink == BitSink::kTogether) ClearRows(room.boxes[threadIdx.x / 32]);
  __syncthreads();
  const uint64_t each = uint64_t(args.rounds) * kCellThreads, begin = chunk * each;
  const uint64_t count = args.triangle_count;
  // Maps a position in the packed corners to a triangle.
  const auto number_at = [&](uint64_t i) {
    if constexpr (kPacked) return args.packed[3 * i].triangle;
    return uint32_t(i);
  };
  // Number of the block's triangles; 32 bits save registers.
  const uint32_t here = begin < count ? uint32_t(min(count - begin, each)) : 0;
  const uint32_t warp = threadIdx.x / 32;
  uint2* const found = room.first_pass.found[warp];
  StagedCorners& staged = room.first_pass.staged[warp];
  // With one iteration per thread there is nothing to prefetch.
  constexpr bool kAhead = kSink != BitSink::kBricks;
  uint32_t kept = 0;
  if (kAhead && threadIdx.x < here) StageCorners<kPacked>(args, uint32_t(begin) + threadIdx.x, staged);
  for (int round = 0; round < args.rounds; ++round) {
    const uint32_t number = uint32_t(round * kCellThreads) + threadIdx.x, then = number + kCellThreads;
    Fetched<kPacked> fetched{};
    if constexpr (kAhead) {
      fetched = TakeStaged<kPacked>(uint32_t(begin) + number, staged);
      if (then < here) StageCorners<kPacked>(args, uint32_t(begin) + then, staged);
    } else if (number < here) {
      fetched = FetchNow<kPacked>(args, uint32_t(begin + number));
    }
    FixedTriangle triangle{};
    uint32_t octants = 0;
    CellFate fate = FindFirst<kThin>(
        args, number < here, fetched, [&] { return uint32_t(begin + number); }, triangle, octants);
    kept = KeepFound<kSink>(triangle.box.first, octants, found, kept);
    if (fate == CellFate::kLarge && IsAmongLargest(args, number_at(begin + number))) fate = CellFate::kDone;
    room.Append(fate, number);
  }
  AwaitCleared(args);  // only shared memory is written before
  __syncwarp();
  for (uint32_t begins = 0; begins < kept; begins += 32) {  // full warps only, so no lanes are idle
    const uint32_t i = begins + threadIdx.x % 32;
    SetFound<kSink>(args, i < kept ? found[i] : uint2{0, 0}, room);
  }
  __syncthreads();
  const uint32_t octant_count = room.octant_count, row_count = room.row_count;
  const auto take_rows = [&](uint32_t i, uint32_t& number) {
    bool uncertain = false;
    if (i < row_count) {
      number = room.RowNumber(i);
      const Fetched<kPacked> of_rows = FetchNow<kPacked>(args, uint32_t(begin + number));
      uncertain = !WalkCellRows<kThin, kPacked, kSink>(args, of_rows, &room.table[0][threadIdx.x]);
    }
    __syncwarp();
    return uncertain;
  };
  const auto take_octants = [&](uint32_t i, uint32_t& number) {
    bool uncertain = false;
    uint32_t octants = 0;
    FixedTriangle triangle{};
    if (i < octant_count) {
      number = room.cells[i];
      triangle.v = LoadFixed(args, FetchNow<kPacked>(args, uint32_t(begin + number)));
      triangle.box = BoxOf(triangle.v.at, args.fixed);
      uncertain = !FindOctants<kThin>(args, triangle, octants);
    }
    __syncwarp();
    SetFound<kSink>(args, PackFound<kSink>(triangle.box.first, octants), room);
    return uncertain;
  };
  TakeTurns(room.turn, row_count, octant_count, take_rows, take_octants, [&](bool uncertain, uint32_t number) {
    AppendInBlock(uncertain, number, room.later, 1, &room.layer_count);
  });
  __syncthreads();
  QueueLater<kPacked>(args, room, [&](uint32_t number) { return number_at(begin + number); });
}

}  // namespace voxelpipe::cuda
