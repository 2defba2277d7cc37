// Every triangle a thread, from world space to the voxels that it touches, where values of four components are blended at once (four_blend.cuh); what is
// larger or in doubt waits for the kernels of span_kernels.cuh.
//
// As FindCells (cell_walk.cuh) has it, but that triangles go by octants as they come, and that corners are asked for a round ahead, into shared memory.
// Included by four_cells.cu alone. No host-only includes.
#pragma once

#include "cuda/cell_walk.cuh"
#include "cuda/corners_ahead.cuh"
#include "cuda/four_blend.cuh"
#include "cuda/span_kernels.cuh"

namespace voxelpipe::cuda {

inline constexpr int kFourThreads = 256;
inline constexpr int kMostFourRounds = 8;
inline constexpr int kFourBlocks = 4;  // on a multiprocessor at once

struct FourWalkArgs {
  BitArgs walk;  // layer_queue takes all that waits
  FourArgs four;
  uint64_t* fragments = nullptr;  // kFragmentSlots counters
};

// A warp's; but for the table and the box it is each lane's own.
struct FourWarpRoom {
  union {
    CellSpan table[kBlockSide][32];
    PositionsAhead positions;
  };
  CornersAhead corners;
  uint4 keys[32];
  LaneBox box;
};
// A block's, whose triangles are numbered from its first one on.
struct FourRoom {
  static constexpr int kTriangles = kMostFourRounds * kFourThreads;
  FourWarpRoom of_warps[kFourThreads / 32];
  uint16_t rows[kTriangles], waiting[kTriangles];  // that wait for rows, and for another kernel
  uint32_t row_count, waiting_count;
  uint32_t turn;  // that the next warp takes
  unsigned long long first;
};

// What triangle t brings, where that is not the normal of corners at hand.
template <int kShader>
__device__ __noinline__ inline uint4 FourKeysOf(const InPlaceArgs& args, uint32_t t) {
  uint32_t key[4] = {};
  KeysOf<kShader, 4>(args, /*plain=*/false, t, key);
  return {key[0], key[1], key[2], key[3]};
}

// kShader: kNormalShader, or -1 for values that stand ready.
template <bool kThin, int kShader>
__global__ void __launch_bounds__(kFourThreads, kFourBlocks) BlendFours(const __grid_constant__ FourWalkArgs args) {
  __shared__ FourRoom room;
  AllowNext();
  const BitArgs& walk = args.walk;
  if (threadIdx.x == 0) room.row_count = room.waiting_count = room.turn = 0;
  __syncthreads();
  FourWarpRoom& own = room.of_warps[threadIdx.x / 32];
  const unsigned lane = threadIdx.x % 32;
  const uint64_t each = uint64_t(walk.rounds) * kFourThreads, chunk = blockIdx.x * each;
  const auto here = uint32_t(min(walk.triangle_count - chunk, each));
  const bool fixed = GoesByFixed(walk);
  const auto slab_begin = uint32_t(walk.grid.slab_begin);
  uint64_t fragments = 0;
  const WalkAhead<kFourThreads> ahead{walk, own.positions, own.corners, chunk, here};
  ahead.Begin();
  for (int round = 0; round < walk.rounds; ++round) {
    const uint32_t local = uint32_t(round) * kFourThreads + threadIdx.x, t = uint32_t(chunk) + local;
    const WorldCorners corners = ahead.Take(local);
    CellFate fate = CellFate::kDone;
    FixedTriangle triangle{};
    uint32_t octants = 0;
    if (local < here) {
      if constexpr (kShader == kNormalShader) {
        own.keys[lane] = KeysOfNormal(args.four.blend, corners.at[0], corners.at[1], corners.at[2]);
      } else {
        own.keys[lane] = FourKeysOf<kShader>(args.four.blend, t);
      }
      if (fixed) {
        triangle.v = FixedOf(walk, corners);
        fate = FindFate<kThin>(walk, triangle, octants);
        if (fate == CellFate::kRows && !IsBlock(walk, triangle.box)) fate = CellFate::kLayers;
      } else {
        fate = FindQueue(walk, t);
      }
    }
    __syncwarp();
    DecideRuns<kThin>(walk, triangle, fate, octants);
    if (fate == CellFate::kOctants) {
      fate = FindOctants<kThin>(walk, triangle, octants) ? CellFate::kDone : CellFate::kLayers;
    }
    __syncwarp();
    int(&box_first)[3] = triangle.box.first;
    if (octants != 0) KeepInside(walk.grid, box_first, octants);
    if (__any_sync(~0u, octants != 0) != 0) {
      fragments += uint32_t(__popc(octants));
      const uint32_t first[3] = {uint32_t(box_first[0]), uint32_t(box_first[1]), uint32_t(box_first[2]) - slab_begin};
      BlendOctantsOfFours(args.four, own.box, own.keys, first, octants);
    }
    if (__any_sync(~0u, WaitsForRows(fate)) == 0) continue;
    AppendInBlock(fate == CellFate::kRows, local, room.rows, 1, &room.row_count);
    AppendInBlock(fate == CellFate::kLayers || fate == CellFate::kLarge, local, room.waiting, 1, &room.waiting_count);
  }
  __syncthreads();
  const uint32_t row_count = room.row_count, turns = (row_count + 31) / 32;
  for (uint32_t turn = NextTurn(room.turn); turn < turns; turn = NextTurn(room.turn)) {
    const uint32_t i = turn * 32 + lane;
    bool doubtful = false;
    uint32_t local = 0;
    if (i < row_count) {
      local = room.rows[i];
      int first[3];
      uint64_t mask = 0;
      doubtful = !FindBlock<kThin, false>(walk, uint32_t(chunk) + local, &own.table[0][lane], first, mask);
      fragments += uint32_t(__popcll(mask));
      const uint32_t in_slab[3] = {uint32_t(first[0]), uint32_t(first[1]), uint32_t(first[2]) - slab_begin};
      if (mask != 0) {
        BlendBlockOfFours(args.four, in_slab, mask, FourKeysOf<kShader>(args.four.blend, uint32_t(chunk) + local));
      }
    }
    __syncwarp();
    AppendInBlock(doubtful, local, room.waiting, 1, &room.waiting_count);
  }
  __syncthreads();
  QueueWaiting(walk, room.waiting, room.waiting_count, room.first,
               [&](uint32_t number) { return uint32_t(chunk) + number; });
  AddFragments(args.fragments, fragments);
}

}  // namespace voxelpipe::cuda
