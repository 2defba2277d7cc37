// Rasterizes and max-blends float4 values in one pass, one thread per triangle (float4_blend.cuh). Larger and uncertain
// triangles are deferred to the kernels of emit_spans.cuh.
//
// Like FindCells (coverage_pass.cuh), except that 2x2x2 masks are processed immediately, and corners are prefetched
// into shared memory one iteration ahead. Included by float4_pass.cu only. No host-only includes.
#pragma once

#include "cuda/coverage/coverage_pass.cuh"
#include "cuda/coverage/emit_spans.cuh"
#include "cuda/scatter/float4_blend.cuh"
#include "cuda/traversal/corner_prefetch.cuh"

namespace voxelpipe::cuda {

inline constexpr int kFourThreads = 256;
inline constexpr int kMaxFourRounds = 8;
inline constexpr int kFourBlocks = 4;  // resident blocks per multiprocessor

struct FourWalkArgs {
  BitArgs walk;  // layer_queue takes all deferred triangles
  FourArgs four;
  uint64_t* fragments = nullptr;  // kFragmentSlots counters
};

// Shared memory of a warp during the main loop; each lane has its own corners.
struct FourWarpRoom {
  CornersAhead corners;
  uint4 keys[32];
  LaneBox box;
};
// Shared memory of a block. Triangles are numbered from the block's first.
struct FourRoom {
  static constexpr int kWarps = kFourThreads / 32, kTriangles = kMaxFourRounds * kFourThreads;
  union {  // per warp and lane
    CellSpan table[kWarps][kBlockSide][32];
    PositionsAhead positions[kWarps];
  };
  union {
    FourWarpRoom of_warps[kWarps];
    uint16_t waiting[2][kTriangles];  // after the main loop: triangles deferred to the row phase and to another kernel
  };
  static constexpr uint32_t kParts = kMaxFourRounds * kWarps;  // a part: one iteration of one warp
  uint32_t lanes[2][kParts];                                   // during the main loop: lane masks of the same triangles
  static_assert(kParts <= uint32_t(kFourThreads) &&
                kTriangles <= 1 << 16);  // one thread clears each part; numbers have 16 bits
  uint32_t row_count, waiting_count;
  uint32_t turn;  // the next work item of a warp
  unsigned long long first;
};

// The keys of triangle t.
template <int kShader>
__device__ __noinline__ inline uint4 FourKeysOf(const InPlaceArgs& args, uint32_t t) {
  uint32_t key[4] = {};
  KeysOf<kShader, 4>(args, /*plain=*/false, t, key);
  return {key[0], key[1], key[2], key[3]};
}

// Like FindFate, but 2x2x2 masks of small boxes are not clipped to the slab yet, and are available even if the triangle
// is still to be decided.
template <bool kThin>
__device__ inline CellFate FindFateOfFour(const BitArgs& walk, FixedTriangle& t, uint32_t& octants) {
  t.box = BoxOf(t.v.at, walk.fixed);
  const FixedBox& box = t.box;
  const int size[3] = {box.last[0] - box.first[0], box.last[1] - box.first[1], box.last[2] - box.first[2]};
  const int greatest = max(size[0], max(size[1], size[2]));
  if (!box.doubtful && greatest <= 1) {
    octants = OctantsOf(box);
    if (size[0] + size[1] + size[2] > 1) return CellFate::kOctants;
    return kThin ? CellFate::kRuns : CellFate::kDone;
  }
  int begin[3], end[3];
  ClipBox(walk, box, begin, end);
  if (IsOutside(box, begin, end)) return CellFate::kDone;
  const CellFate fate = FateByRows(box, greatest, begin, end);
  return fate == CellFate::kRows && !IsBlock(walk, box) ? CellFate::kLayers : fate;
}

// kShader: kNormalShader, or -1 for precomputed values.
template <bool kThin, int kShader>
__global__ void __launch_bounds__(kFourThreads, kFourBlocks) BlendFours(const __grid_constant__ FourWalkArgs args) {
  __shared__ FourRoom room;
  AllowNext();
  const BitArgs& walk = args.walk;
  const uint32_t lane = threadIdx.x % 32, warp = threadIdx.x / 32, before = LanesBefore();
  FourWarpRoom& own = room.of_warps[warp];
  own.box.Clear();
  if (threadIdx.x < FourRoom::kParts) room.lanes[0][threadIdx.x] = room.lanes[1][threadIdx.x] = 0;
  if (threadIdx.x == 0) room.row_count = room.waiting_count = room.turn = 0;
  __syncthreads();
  const uint32_t chunk = blockIdx.x * uint32_t(walk.rounds) * kFourThreads;
  const uint32_t end = uint32_t(min(walk.triangle_count, uint64_t{chunk} + uint32_t(walk.rounds) * kFourThreads));
  const auto slab_begin = uint32_t(walk.grid.slab_begin);
  uint32_t fragments = 0;
  bool some_wait = false;
  const WalkAhead<kFourThreads> ahead{walk, room.positions[warp], own.corners, end};
  ahead.Begin(chunk + threadIdx.x);
  for (int round = 0; round < walk.rounds; ++round) {
    const uint32_t t = chunk + uint32_t(round) * kFourThreads + threadIdx.x;
    const WorldCorners corners = ahead.Take(t);
    FixedTriangle triangle;
    triangle.v = FixedOf(walk, corners);
    uint32_t doubt = 0;
    if constexpr (kShader == kNormalShader) {
      Vec3f normal;
      doubt = NormalizeQuickly(Cross(corners.at[1] - corners.at[0], corners.at[2] - corners.at[0]),
                               args.four.blend.degenerate.least_small, normal);
      own.keys[lane] = KeysOfUnit(normal, args.four.flip);
    } else if (t < end) {
      own.keys[lane] = FourKeysOf<kShader>(args.four.blend, t);
    }
    uint32_t octants = 0;
    CellFate fate = FindFateOfFour<kThin>(walk, triangle, octants);
    if (doubt != 0 && octants != 0) fate = CellFate::kLayers;
    if (t >= end) fate = CellFate::kDone, octants = 0;
    __syncwarp();
    DecideRuns<kThin>(walk, triangle, fate, octants);
    if (fate == CellFate::kOctants) {
      const FixedBox& box = triangle.box;
      const Octants o = kThin ? TouchedOctants<true>(triangle.v.at, box, octants, walk.fixed)
                              : TouchedQuickly(triangle.v.at, box, octants, walk.fixed);
      octants = o.touched;
      fate = o.doubtful ? CellFate::kLayers : CellFate::kDone;
    }
    if (fate != CellFate::kDone) octants = 0;
    __syncwarp();
    FixedBox& box = triangle.box;
    const auto inside = [&](int a) { return uint32_t(box.first[a]) - (a == 2 ? slab_begin : 0) < args.four.inner[a]; };
    if (!args.four.all_within && octants != 0 && !(inside(0) & inside(1) & inside(2)))
      KeepInside(walk.grid, box.first, octants);
    if (__any_sync(~0u, octants != 0) != 0) {
      fragments += uint32_t(__popc(int(octants)));
      const uint32_t first[3] = {uint32_t(box.first[0]), uint32_t(box.first[1]), uint32_t(box.first[2]) - slab_begin};
      const uint32_t last[3] = {uint32_t(box.last[0]), uint32_t(box.last[1]), uint32_t(box.last[2]) - slab_begin};
      BlendOctantsOfFours<kShader == kNormalShader>(args.four, own.box, own.keys, before, first, last, octants);
    }
    if (__any_sync(~0u, WaitsForRows(fate)) == 0) continue;
    some_wait = true;
    const uint32_t rows = __ballot_sync(~0u, fate == CellFate::kRows);
    const uint32_t others = __ballot_sync(~0u, fate == CellFate::kLayers || fate == CellFate::kLarge);
    if (lane == 0) {
      room.lanes[0][uint32_t(round) * FourRoom::kWarps + warp] = rows;
      room.lanes[1][uint32_t(round) * FourRoom::kWarps + warp] = others;
    }
  }
  if (__syncthreads_or(some_wait) != 0) {
    for (int round = 0; round < walk.rounds; ++round) {
      const uint32_t local = uint32_t(round) * kFourThreads + threadIdx.x;
      AppendInBlock((room.lanes[0][uint32_t(round) * FourRoom::kWarps + warp] >> lane & 1) != 0, local, room.waiting[0],
                    1, &room.row_count);
      AppendInBlock((room.lanes[1][uint32_t(round) * FourRoom::kWarps + warp] >> lane & 1) != 0, local, room.waiting[1],
                    1, &room.waiting_count);
    }
    __syncthreads();
    const uint32_t row_count = room.row_count;
    const auto take_rows = [&](uint32_t i, uint32_t& local) {
      bool uncertain = false;
      if (i < row_count) {
        local = room.waiting[0][i];
        int voxel[3];
        uint64_t mask = 0;
        uncertain = !FindBlock<kThin, false>(walk, chunk + local, &room.table[warp][0][lane], voxel, mask);
        fragments += uint32_t(__popcll(mask));
        const uint32_t first[3] = {uint32_t(voxel[0]), uint32_t(voxel[1]), uint32_t(voxel[2]) - slab_begin};
        if (mask != 0) BlendBlockOfFours(args.four, first, mask, FourKeysOf<kShader>(args.four.blend, chunk + local));
      }
      __syncwarp();
      return uncertain;
    };
    const auto no_octants = [](uint32_t, uint32_t&) { return false; };
    TakeTurns(room.turn, row_count, 0, take_rows, no_octants, [&](bool uncertain, uint32_t local) {
      AppendInBlock(uncertain, local, room.waiting[1], 1, &room.waiting_count);
    });
    __syncthreads();
    QueueWaiting(walk, room.waiting[1], room.waiting_count, room.first,
                 [&](uint32_t number) { return chunk + number; });
  }
  AddFragments(args.fragments, fragments);
}

}  // namespace voxelpipe::cuda
