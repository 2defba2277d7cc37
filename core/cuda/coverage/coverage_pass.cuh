// The coverage pass: one thread per triangle finds the voxels that it touches. Small triangles become a record
// (coverage_record.h) or are blended at once. Larger triangles, and those for which the floating-point filter is
// uncertain, are deferred to the kernels of emit_spans.cuh.
//
// The work is ordered as in WalkCells (small_triangles.cuh): first bounding boxes; then, compacted over the block,
// 2x2x2 masks and rows. No host-only includes.
#pragma once

#include "cuda/coverage/atomic_blend.cuh"
#include "cuda/coverage/brick_scatter.cuh"
#include "cuda/coverage/warp_max_tile.cuh"
#include "cuda/coverage/warp_segments.cuh"
#include "cuda/primitives/coverage_record.h"
#include "cuda/primitives/span.h"
#include "cuda/traversal/small_triangles.cuh"

namespace voxelpipe::cuda {

// With 128 threads (kCellThreads) 10 M triangles of a sphere take .07 to .09 ms longer.
inline constexpr int kFindThreads = 256;
inline constexpr int kMaxFindRounds = 8;
inline constexpr int kFindBlocks = 4;  // resident blocks of FindCells per multiprocessor

// The output of the pass.
enum class CellSink {
  kRecords,         // records only
  kRecordsAndBits,  // records, and bits of the coverage
  kBlend,           // max blend in the dense target, and bits of the coverage
  kPool,            // max blend in a brick pool
};

struct CellArgs {
  BitArgs walk;                   // `bits` is the coverage; layer_queue takes all deferred triangles
  uint64_t* records = nullptr;    // per triangle, in processing order
  uint64_t* blocks = nullptr;     // masks of the records that are blocks
  uint64_t* fragments = nullptr;  // kFragmentSlots counters; null: not counted
  FragmentCounts chunks;          // fragments per chunk of records
  InPlaceArgs blend;
  BrickPool pool;
};

// Shared memory of a warp.
template <CellSink kSink>
struct FindWarpRoom {
  union {
    CellSpan table[kBlockSide][32];
    StagedCorners staged;
  };
};
template <>
struct FindWarpRoom<CellSink::kBlend> {
  union {
    CellSpan table[kBlockSide][32];
    KeyBox keys;
    CellRunRoom<uint32_t, 1> runs;
  };
  StagedCorners staged;
};
template <CellSink kSink>
struct FindRoom {
  static constexpr int kTriangles = kMaxFindRounds * kFindThreads;
  FindWarpRoom<kSink> of_warps[kFindThreads / 32];
  // Small triangles left to do: for 2x2x2 masks from the front, for rows from the back.
  uint16_t cells[kTriangles];
  uint16_t waiting[kTriangles];  // deferred to another kernel
  uint32_t octant_count, row_count, waiting_count;
  uint32_t turn;  // the next work item of a warp
  unsigned long long first;
};

// Bit index of a voxel in the slab's bit grid, which has fewer than 2^32 bits.
__device__ inline uint32_t BitOfVoxel(const GridView& grid, int x, int y, int z) {
  const uint32_t row = uint32_t(grid.dims[1]) * uint32_t(z - int(grid.slab_begin)) + uint32_t(y);
  return row * uint32_t(grid.words_per_row) * 32 + uint32_t(x);
}

// Clips a 2x2x2 mask to the grid and moves its first voxel inside. False if nothing is left.
__device__ inline bool KeepInside(const GridView& grid, int (&first)[3], uint32_t& octants) {
  const int low[3] = {0, 0, int(grid.slab_begin)};
  const int high[3] = {int(grid.dims[0]), int(grid.dims[1]), int(grid.slab_end)};
  constexpr uint32_t kNear[3] = {0x55, 0x33, 0x0f};
  bool inside = true;  // the usual case
#pragma unroll
  for (int a = 0; a < 3; ++a) inside = inside & (uint32_t(first[a] - low[a]) < uint32_t(high[a] - low[a] - 1));
  if (inside) return octants != 0;
#pragma unroll
  for (int a = 0; a < 3; ++a) {
    if (first[a] < low[a]) {
      octants = octants >> (1 << a) & kNear[a];
      ++first[a];
    }
    if (first[a] + 1 >= high[a]) octants &= kNear[a];
    if (first[a] < low[a] || first[a] >= high[a]) octants = 0;
  }
  return octants != 0;
}

// Bit index of voxel `octant` of a 2x2x2 mask whose first voxel has bit index `first`.
__device__ inline uint32_t BitOfOctant(const GridView& grid, uint32_t first, int octant) {
  const auto row = uint32_t(grid.words_per_row) * 32;
  return first + uint32_t(octant & 1) + ((octant & 2) != 0 ? row : 0) +
         ((octant & 4) != 0 ? row * uint32_t(grid.dims[1]) : 0);
}

// Sets the bits of mask `which` (up to 32 bits) from bit `first` on.
__device__ inline void CoverBits(uint32_t* bits, uint32_t first, uint32_t which) {
  const uint64_t mask = uint64_t{which} << (first % 32);
  uint32_t* const word = bits + first / 32;
  if (uint32_t(mask) != 0) atomicOr(word, uint32_t(mask));
  if (uint32_t(mask >> 32) != 0) atomicOr(word + 1, uint32_t(mask >> 32));
}

// Calls visit(bit index of the row's first voxel, mask of four voxels) for each row of a block.
template <typename Visit>
__device__ inline void ForEachBlockRow(const GridView& grid, uint32_t first, uint64_t mask, Visit&& visit) {
  const auto row = uint32_t(grid.words_per_row) * 32;
  for (int z = 0; mask != 0; ++z, mask >>= 16, first += row * uint32_t(grid.dims[1])) {
    uint32_t layer = uint32_t(mask) & 0xffff;
    for (uint32_t at = first; layer != 0; layer >>= 4, at += row) {
      if ((layer & 15) != 0) visit(at, layer & 15);
    }
  }
}

// Max-blends a key into the voxels of a 2x2x2 mask and sets their coverage.
__device__ inline void BlendOctants(const CellArgs& args, uint32_t first, uint32_t octants, uint32_t key) {
  const GridView& grid = args.walk.grid;
  const auto row = uint32_t(grid.words_per_row) * 32, layer = row * uint32_t(grid.dims[1]);
#pragma unroll
  for (uint32_t pair = 0; pair < 4; ++pair) {
    const uint32_t two = octants >> 2 * pair & 3;
    if (two == 0) continue;
    const uint32_t bit = first + ((pair & 1) != 0 ? row : 0) + ((pair & 2) != 0 ? layer : 0);
    CoverBits(args.walk.bits, bit, two);
    uint32_t* const out = args.blend.out + VoxelOfBit(bit, args.blend.nx, args.blend.words_per_row);
    if ((two & 1) != 0) atomicMax(out, key);
    if ((two & 2) != 0) atomicMax(out + 1, key);
  }
}

// Removes from each lane's 2x2x2 mask the voxels for which another lane has a larger key. False if the warp's tile
// cannot hold all voxels: then masks are unchanged. All lanes call it.
__device__ inline bool LargestAmongLanes(KeyBox& box, const int (&first)[3], uint32_t& octants, uint32_t key) {
  uint32_t from[3], last[3];
#pragma unroll
  for (int a = 0; a < 3; ++a) {
    from[a] = uint32_t(first[a]);
    last[a] = from[a] + ((octants & HalfOf(a)) != 0 ? 1 : 0);
  }
  const KeyPlace place = FitKeys(octants != 0, from, last);
  if (!place.fits()) return false;
  __syncwarp();
  ClearKeys(box, place);
  __syncwarp();
  uint32_t* const cells = box.cells + (octants != 0 ? place.At(first) : 0);
  const auto cell = [&](uint32_t i) {
    return cells + (i & 1) + ((i & 2) != 0 ? place.row : 0) + ((i & 4) != 0 ? place.layer : 0);
  };
#pragma unroll
  for (uint32_t i = 0; i < 8; ++i) {
    if ((octants >> i & 1) != 0) atomicMax(cell(i), key);
  }
  __syncwarp();
  uint32_t smaller = 0;  // reads all cells before the first use, to overlap latencies
#pragma unroll
  for (uint32_t i = 0; i < 8; ++i) {
    if ((octants >> i & 1) != 0 && *cell(i) != key) smaller |= 1u << i;
  }
  octants &= ~smaller;
  return true;
}

// Outputs the 2x2x2 masks of a warp's triangles. `takes`: the lane has a triangle t, and `record` is its record number.
// `in_order`: triangle ids increase with lanes.
template <CellSink kSink, int kShader, bool kPacked>
__device__ inline void TakeOctants(const CellArgs& args, FindWarpRoom<kSink>& room, bool plain, bool in_order,
                                   bool takes, uint32_t t, uint64_t record, int (&first)[3], uint32_t octants,
                                   uint64_t& fragments) {
  uint32_t bit = 0;
  if (octants != 0 && KeepInside(args.walk.grid, first, octants)) {
    bit = BitOfVoxel(args.walk.grid, first[0], first[1], first[2]);
  }
  fragments += uint32_t(__popc(octants));
  if constexpr (kSink == CellSink::kPool) {
    if (__any_sync(~0u, octants != 0) == 0) return;
    uint32_t key[1] = {};
    if (octants != 0) KeysOf<kShader, 1>(args.blend, plain, IdOf<kPacked>(args.walk, t), key);
    if (kShader >= 0 && in_order) octants = OctantsAlone(bit, octants, args.blend.blend == InPlace::kMax);
    const int local[3] = {first[0], first[1], first[2] - int(args.walk.grid.slab_begin)};
    BlendOctantsInPool(args.pool, local, octants, key[0]);
  } else if constexpr (kSink != CellSink::kBlend) {
    if (takes) args.records[record] = octants == 0 ? 0 : PackCell(CellKind::kOctants, bit, octants);
    if constexpr (kSink == CellSink::kRecordsAndBits) SetOctantsTogether(args.walk, first, octants);
  } else {
    if (__any_sync(~0u, octants != 0) == 0) return;
    uint32_t key[1] = {};
    if (octants != 0) KeysOf<kShader, 1>(args.blend, /*plain=*/false, IdOf<kPacked>(args.walk, t), key);
    const bool is_float = args.blend.negative != nullptr;  // float keys are never 0
    if (is_float && LargestAmongLanes(room.keys, first, octants, key[0])) {
      BlendOctants(args, bit, octants, plain ? key[0] ^ 0x80000000u : key[0]);
      return;
    }
    if (plain) key[0] ^= 0x80000000u;
    if constexpr (kShader >= 0) {
      // Triangle ids increase with lanes (see FindCells), so one lane of a run has the largest key of a voxel and
      // nothing has to be combined.
      if (in_order) octants = OctantsAlone(bit, octants, args.blend.blend == InPlace::kMax);
      BlendOctants(args, bit, octants, key[0]);
    } else {
      CombineRuns<uint32_t, 1>(
          room.runs, bit, octants, key, [](uint32_t a, uint32_t b) { return max(a, b); },
          [&](const OctantOfRun<uint32_t, 1>& of) {
            const uint32_t bit_of = BitOfOctant(args.walk.grid, of.first, of.octant);
            if (of.octant % 2 == 0 && (of.count | of.beside) != 0) {
              CoverBits(args.walk.bits, bit_of, (of.count != 0 ? 1u : 0u) | (of.beside != 0 ? 2u : 0u));
            }
            if (of.count == 0) return;
            atomicMax(args.blend.out + VoxelOfBit(bit_of, args.blend.nx, args.blend.words_per_row), of.value[0]);
          });
    }
  }
}

// A 4x4x4 block found by a lane that the whole warp then blends.
struct FoundBlock {
  int first[3] = {};  // of the slab
  uint64_t mask = 0;
  uint32_t key[1] = {};  // an order-preserving key, not a plain float
};

// Max-blends a key into the voxels of a 4x4x4 block and sets their coverage.
__device__ inline void BlendBlock(const CellArgs& args, uint32_t first, uint64_t mask, uint32_t key) {
  ForEachBlockRow(args.walk.grid, first, mask, [&](uint32_t at, uint32_t four) {
    CoverBits(args.walk.bits, at, four);
    const uint64_t n = VoxelOfBit(at, args.blend.nx, args.blend.words_per_row);
#pragma unroll
    for (uint32_t x = 0; x < uint32_t(kBlockSide); ++x) {
      if ((four >> x & 1) != 0) atomicMax(args.blend.out + n + x, key);
    }
  });
}

// True if a triangle with this bounding box fits in a 4x4x4 block.
__device__ inline bool IsBlock(const BitArgs& walk, const FixedBox& box) {
  int begin[3], end[3];
  ClipBox(walk, box, begin, end);
  return max(end[0] - begin[0], max(end[1] - begin[1], end[2] - begin[2])) <= kBlockSide;
}

// Finds the voxels of such a triangle, relative to voxel `begin` of the grid. False if the filter is uncertain for some
// voxel.
template <bool kThin, bool kPacked>
__device__ inline bool FindBlock(const BitArgs& walk, uint32_t t, CellSpan* table, int (&begin)[3], uint64_t& mask) {
  const FixedCorners v = LoadFixed<kPacked>(walk, t);
  const FixedBox box = BoxOf(v.at, walk.fixed);
  int end[3];
  ClipBox(walk, box, begin, end);
  uint64_t found = 0;
  const int single = (box.first[0] == box.last[0]) + (box.first[1] == box.last[1]) + (box.first[2] == box.last[2]);
  const bool run = !kThin && single >= 2;  // touches a single run of voxels
  const int outside = begin[0] - box.first[0];
  const auto add = [&](int y, int z, int x, int count) {
    found |= uint64_t{(1u << count) - 1} << (x - outside + kBlockSide * (y + kBlockSide * z));
  };
  if (!VisitCells<kThin>(v.at, box, begin, end, walk.fixed, table, 32, run, EachRow(add))) return false;
  mask = found;
  return true;
}

// Outputs a triangle of few rows as a block. False if the filter is uncertain for some voxel.
template <bool kThin, CellSink kSink, int kShader, bool kPacked>
__device__ inline bool TakeBlock(const CellArgs& args, uint32_t t, uint64_t record, CellSpan* table,
                                 uint64_t& fragments, FoundBlock& found) {
  int begin[3];
  uint64_t mask = 0;
  if (!FindBlock<kThin, kPacked>(args.walk, t, table, begin, mask)) return false;
  fragments += uint32_t(__popcll(mask));
  if constexpr (kSink == CellSink::kPool || kSink == CellSink::kBlend) {
    for (int a = 0; a < 3; ++a) found.first[a] = begin[a];
    found.first[2] -= int(args.walk.grid.slab_begin);
    found.mask = mask;
    KeysOf<kShader, 1>(args.blend, /*plain=*/false, IdOf<kPacked>(args.walk, t), found.key);
    return true;
  }
  const uint32_t first = BitOfVoxel(args.walk.grid, begin[0], begin[1], begin[2]);
  args.records[record] = PackCell(CellKind::kBlock, first, 0);
  args.blocks[record] = mask;
  if constexpr (kSink == CellSink::kRecordsAndBits) {
    ForEachBlockRow(args.walk.grid, first, mask,
                    [&](uint32_t at, uint32_t four) { CoverBits(args.walk.bits, at, four); });
  }
  return true;
}

// Appends a thread block's deferred triangles to the layer queue. triangle_at maps a number within the block to a
// triangle; `first` is in shared memory. All threads of the block call it, after a barrier.
template <typename TriangleAt>
__device__ inline void QueueWaiting(const BitArgs& walk, const uint16_t* waiting, uint32_t count,
                                    unsigned long long& first, TriangleAt&& triangle_at) {
  if (threadIdx.x == 0 && count > 0) {
    first = atomicAdd(reinterpret_cast<unsigned long long*>(walk.queued), 0ull + count);
  }
  __syncthreads();
  for (uint32_t i = threadIdx.x; i < count; i += blockDim.x) walk.layer_queue[first + i] = triangle_at(waiting[i]);
}

// kShader: the triangle-id shader, whose values increase with triangles, or -1 for any other. kPacked: reads packed
// corners.
template <bool kThin, CellSink kSink, int kShader, bool kPacked>
__global__ void __launch_bounds__(kFindThreads, kFindBlocks) FindCells(const __grid_constant__ CellArgs args) {
  __shared__ FindRoom<kSink> room;
  AllowNext();
  const BitArgs& walk = args.walk;
  if (threadIdx.x == 0) room.octant_count = room.row_count = room.waiting_count = room.turn = 0;
  __syncthreads();
  // Ids are never negative.
  const bool plain =
      kSink == CellSink::kBlend && args.blend.negative != nullptr && (kShader >= 0 || *args.blend.negative == 0);
  FindWarpRoom<kSink>& own = room.of_warps[threadIdx.x / 32];
  const uint64_t chunk = uint64_t(blockIdx.x) * uint64_t(walk.rounds) * kFindThreads;
  const uint64_t count = walk.triangle_count;
  uint64_t fragments = 0;
  StagedCorners& staged = own.staged;
  if (chunk + threadIdx.x < count) StageCorners<kPacked>(walk, uint32_t(chunk + threadIdx.x), staged);
  for (int round = 0; round < walk.rounds; ++round) {
    const uint32_t local = uint32_t(round) * kFindThreads + threadIdx.x;
    const uint64_t number = chunk + local, then = number + kFindThreads;
    const auto t = uint32_t(number);
    const Fetched<kPacked> fetched = TakeStaged<kPacked>(t, staged);
    if (round + 1 < walk.rounds && then < count) StageCorners<kPacked>(walk, uint32_t(then), staged);
    FixedTriangle triangle{};
    uint32_t octants = 0;
    CellFate fate = FindFirst<kThin>(
        walk, number < count, fetched, [t] { return t; }, triangle, octants);
    if (fate == CellFate::kRows && !IsBlock(walk, triangle.box)) fate = CellFate::kLayers;
    TakeOctants<kSink, kShader, kPacked>(args, own, plain, !kPacked, fate == CellFate::kDone && number < count, t,
                                         number, triangle.box.first, octants, fragments);
    AppendInBlock(fate == CellFate::kOctants, local, room.cells, 1, &room.octant_count);
    if (__any_sync(~0u, WaitsForRows(fate)) == 0) continue;
    AppendInBlock(fate == CellFate::kRows, local, room.cells + (FindRoom<kSink>::kTriangles - 1), -1, &room.row_count);
    AppendInBlock(fate == CellFate::kLayers || fate == CellFate::kLarge, local, room.waiting, 1, &room.waiting_count);
  }
  __syncthreads();
  const uint32_t octant_count = room.octant_count, row_count = room.row_count;
  const auto take_rows = [&](uint32_t i, uint32_t& local) {
    bool uncertain = false;
    FoundBlock found;
    __syncwarp();  // the table aliases shared memory that is read above
    if (i < row_count) {
      local = room.cells[FindRoom<kSink>::kTriangles - 1 - int(i)];
      uncertain = !TakeBlock<kThin, kSink, kShader, kPacked>(args, uint32_t(chunk + local), chunk + local,
                                                             &own.table[0][threadIdx.x % 32], fragments, found);
    }
    __syncwarp();
    if constexpr (kSink == CellSink::kPool) BlendBlockInPool(args.pool, found.first, found.mask, found.key[0]);
    if constexpr (kSink == CellSink::kBlend) {
      const GridView& grid = walk.grid;
      if (found.mask != 0) {
        const uint32_t bit = BitOfVoxel(grid, found.first[0], found.first[1], found.first[2] + int(grid.slab_begin));
        BlendBlock(args, bit, found.mask, found.key[0] ^ (plain ? 0x80000000u : 0));
      }
    }
    return uncertain;
  };
  const auto take_octants = [&](uint32_t i, uint32_t& local) {
    bool uncertain = false;
    uint32_t t = 0, octants = 0;
    FixedTriangle triangle{};
    if (i < octant_count) {
      local = room.cells[i];
      t = uint32_t(chunk + local);
      triangle.v = LoadFixed<kPacked>(walk, t);
      triangle.box = BoxOf(triangle.v.at, walk.fixed);
      uncertain = !FindOctants<kThin>(walk, triangle, octants);
    }
    __syncwarp();
    TakeOctants<kSink, kShader, kPacked>(args, own, plain, false, i < octant_count && !uncertain, t, chunk + local,
                                         triangle.box.first, octants, fragments);
    return uncertain;
  };
  TakeTurns(room.turn, row_count, octant_count, take_rows, take_octants, [&](bool uncertain, uint32_t local) {
    AppendInBlock(uncertain, local, room.waiting, 1, &room.waiting_count);
  });
  __syncthreads();
  QueueWaiting(walk, room.waiting, room.waiting_count, room.first, [&](uint32_t local) {
    const uint64_t number = chunk + local;
    if constexpr (kSink == CellSink::kRecords || kSink == CellSink::kRecordsAndBits) {
      args.records[number] = PackCell(CellKind::kOther, 0, 0);
    }
    return IdOf<kPacked>(walk, uint32_t(number));
  });
  __syncthreads();
  if (args.fragments == nullptr && args.chunks.of_block == nullptr) return;
  for (int step = 16; step > 0; step /= 2) fragments += __shfl_down_sync(~0u, fragments, step);
  const bool counts = threadIdx.x % 32 == 0;
  if (counts && fragments > 0 && args.fragments != nullptr) {
    atomicAdd(reinterpret_cast<unsigned long long*>(args.fragments + blockIdx.x % kFragmentSlots), 0ull + fragments);
  }
  if (args.chunks.of_block == nullptr) return;
  if (threadIdx.x == 0) room.first = 0;
  __syncthreads();
  if (counts) atomicAdd(&room.first, 0ull + fragments);
  __syncthreads();
  if (threadIdx.x > 0) return;
  args.chunks.of_block[blockIdx.x] = room.first;
  atomicAdd(reinterpret_cast<unsigned long long*>(args.chunks.of_groups + blockIdx.x / args.chunks.chunks_of_group),
            room.first);
}

}  // namespace voxelpipe::cuda
