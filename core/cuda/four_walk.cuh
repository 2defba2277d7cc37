// Every triangle a thread, from world space to the voxels that it touches, where values of four components are blended at once (four_blend.cuh); what is
// larger or in doubt waits for the kernels of span_kernels.cuh.
//
// As FindCells (cell_walk.cuh) has it, but that triangles go by octants as they come, and that corners are asked for a round ahead, into shared memory.
// Included by four_cells.cu alone. No host-only includes.
#pragma once

#include "cuda/cell_walk.cuh"
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
    double positions[32][9];  // corners of the next triangle
  };
  uint32_t corners[2][32][3];  // their numbers, and those of the triangle after that
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

// What a block asks for ahead of its triangle `local`.
struct FourAhead {
  const BitArgs& walk;
  FourWarpRoom& room;
  uint64_t chunk;  // the block's first triangle
  uint32_t here;   // how many it has

  __device__ uint32_t (&CornersOf(uint32_t local) const)[3] {
    return room.corners[local / kFourThreads % 2][threadIdx.x % 32];
  }
  __device__ void AskCorners(uint32_t local) const {
    if (local >= here) return;
    const uint32_t* const from = walk.triangles + 3 * (chunk + local);
    uint32_t(&to)[3] = CornersOf(local);
    for (int c = 0; c < 3; ++c) CopyLater(to + c, from + c);
  }
  // Once its corners are there.
  __device__ void AskPositions(uint32_t local) const {
    if (local >= here) return;
    const uint32_t(&v)[3] = CornersOf(local);
    double(&to)[9] = room.positions[threadIdx.x % 32];
    for (int c = 0; c < 3; ++c) {
      const double* const from = &walk.positions[v[c]].x;
      for (int a = 0; a < 3; ++a) CopyLater(to + (3 * c + a), from + a);
    }
  }
};

// What triangle t brings, where that is not the normal of corners at hand.
template <int kShader>
__device__ __noinline__ inline uint4 FourKeysOf(const InPlaceArgs& args, uint32_t t) {
  uint32_t key[4] = {};
  KeysOf<kShader, 4>(args, /*plain=*/false, t, key);
  return {key[0], key[1], key[2], key[3]};
}

// kShader: that of normals, or -1 for values that stand ready.
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
  const FourAhead ahead{walk, own, chunk, here};
  ahead.AskCorners(threadIdx.x);
  AwaitCopies();
  ahead.AskPositions(threadIdx.x);
  ahead.AskCorners(threadIdx.x + kFourThreads);
  for (int round = 0; round < walk.rounds; ++round) {
    const uint32_t local = uint32_t(round) * kFourThreads + threadIdx.x, t = uint32_t(chunk) + local;
    AwaitCopies();
    const double(&p)[9] = own.positions[lane];
    const Vec3d corners[3] = {{p[0], p[1], p[2]}, {p[3], p[4], p[5]}, {p[6], p[7], p[8]}};
    ahead.AskPositions(local + kFourThreads);
    ahead.AskCorners(local + 2 * kFourThreads);
    CellFate fate = CellFate::kDone;
    FixedTriangle triangle{};
    uint32_t octants = 0;
    if (local < here) {
      if constexpr (IsNormalShader(kShader)) {
        own.keys[lane] = KeysOfNormal(args.four.blend, corners[0], corners[1], corners[2]);
      } else {
        own.keys[lane] = FourKeysOf<kShader>(args.four.blend, t);
      }
      if (fixed) {
        for (int c = 0; c < 3; ++c) {
          for (int a = 0; a < 3; ++a) {
            triangle.v.at[c][a] = ToFixed(corners[c][a], walk.fixed.scale[a], walk.fixed.offset[a]);
          }
        }
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
