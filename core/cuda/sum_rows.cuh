// Dense sums of scattered triangles: every cell of the result is written once, with its sum or with the clear value, so that nothing clears it
// before. The sums of small triangles stand in accumulators (span_blend.cuh); the few largest triangles of a mesh need none: warps that
// write a row find what they cover of it, a lane each.
//
// A warp has a part of a row in shared memory. First what each of the largest triangles brings is left where no other triangle is; then come
// the voxels that several cover, and those of small triangles. Between two parts all cells are 0.
// No host-only includes.
#pragma once

#include "cuda/row_parts.cuh"
#include "cuda/span_store.cuh"

namespace voxelpipe::cuda {

inline constexpr int kRowThreads = 256, kRowBlocks = 4;

struct SumRowArgs {
  StoreArgs store;        // of sums, in rows of whole words, and a format of 32 bits
  AccumulateArgs brings;  // what the largest triangles bring
  bool by_id = false;     // their number
  uint32_t clear_stored = 0;
  BitArgs walk;                   // its `largest` are drawn here
  uint32_t* coverage = nullptr;   // becomes that of the largest triangles too; null: another launch sees to it
  uint64_t* fragments = nullptr;  // likewise, kFragmentSlots counters
};

// Of a warp. Stored cells stand there XORed with the clear value, so that 0 is a voxel that nothing covers.
struct RowPart {
  alignas(16) uint32_t cells[kRowCells];
  uint32_t covered[kRowCells / 32];  // by the largest triangles
  uint32_t several[kRowCells / 32];  // by several of them, or by small ones
};

template <int kComponents>
struct SumRowRoom {
  static constexpr int kVoxels = kRowCells / kComponents, kWords = kVoxels / 32;  // of a part
  RowPart parts[kRowThreads / 32];
  int64_t terms[kMostApart][kComponents];
  SharedSetup setups[kMostApart];
};

// A sum as it is stored: with two formats alone little code is left, for which large kernels wait more than for anything else.
__device__ inline uint32_t StoredCellOf(const SumRowArgs& args, int64_t sum) {
  const StoreArgs& store = args.store;
  return (store.is_float ? StoreSum(sum, VoxelFormat::kF32, store.quantum)
                         : StoreSum(sum, VoxelFormat::kU32, store.quantum)) ^
         args.clear_stored;
}

// The voxels of a set-up triangle in the row of a part; an empty range without any.
__device__ inline void FindSpan(const SharedSetup& s, const RowPartPlace& place, int& x_begin, int& x_end) {
  PieceLayer layer;
  const bool has =
      FindLayer(s, place.y, place.z, layer) && layer.begin == 0 && FindRow(s, layer, place.y, x_begin, x_end);
  if (!has) x_begin = x_end = 0;
}

// Sets up the largest triangles; how many there are. All threads of a block call it.
template <int kIdShader, int kComponents>
__device__ inline uint32_t SetUpLargest(const SumRowArgs& args, SumRowRoom<kComponents>& room) {
  return SetUpApart(args.walk, room.setups, [&](uint32_t i, uint32_t t) {
    int64_t(&term)[kComponents] = room.terms[i];
    args.by_id ? TermsOf<kIdShader, kComponents>(args.brings, t, term) : TermsOf<-1, kComponents>(args.brings, t, term);
  });
}

// What a lane's triangle covers of a part, and what it leaves where no other triangle is.
template <int kComponents>
struct DrawnSpan {
  int begin = 0, end = 0;
  uint32_t cells[kComponents] = {};
};

// Draws the lanes' spans; `small` are the voxels of the lane's word that small triangles cover. The word's voxels that any span covers; those
// that are left for later stand in part.several. All lanes of a warp call it.
template <int kComponents>
__device__ inline uint32_t DrawSpans(RowPart& part, const DrawnSpan<kComponents>& span, uint32_t small) {
  const unsigned lane = threadIdx.x % 32;
  part.covered[lane] = 0;
  part.several[lane] = small;
  __syncwarp();
  ForEachWordOf(span.begin, span.end, [&](int word, uint32_t mask) {
    const uint32_t others = atomicOr(part.covered + word, mask) & mask;
    if (others != 0) atomicOr(part.several + word, others);
  });
  __syncwarp();
  ForEachVoxel(uint32_t(span.end - span.begin), [&](int owner, uint32_t before, bool there) {
    const int x = __shfl_sync(~0u, span.begin, owner) + int(before);
    const bool alone = there && (part.several[x / 32] >> x % 32 & 1) == 0;
#pragma unroll
    for (int c = 0; c < kComponents; ++c) {
      const uint32_t cell = __shfl_sync(~0u, span.cells[c], owner);
      if (alone) part.cells[x * kComponents + c] = cell;
    }
  });
  return part.covered[lane];
}

// Voxels of a lane's word that small triangles alone cover: `alone` among `small`, which are accumulated from `rank` on. Some at a time, for
// memory is slow to answer while rows are stored.
template <int kComponents>
__device__ inline void FillSmall(const SumRowArgs& args, RowPart& part, uint32_t small, uint32_t rank, uint32_t alone) {
  constexpr int kAtOnce = kComponents == 1 ? 4 : 1;
  uint32_t* const cells = part.cells + threadIdx.x % 32 * 32 * kComponents;
  while (alone != 0) {
    int bit[kAtOnce];
    int64_t sum[kAtOnce][kComponents] = {};
#pragma unroll
    for (int i = 0; i < kAtOnce; ++i) {
      bit[i] = __ffs(int(alone)) - 1;
      if (bit[i] < 0) continue;
      alone &= alone - 1;
      const uint64_t of = rank + uint32_t(__popc(small & ((1u << bit[i]) - 1)));
#pragma unroll
      for (int c = 0; c < kComponents; ++c) sum[i][c] = int64_t(args.store.from.sums[of * kComponents + unsigned(c)]);
    }
#pragma unroll
    for (int i = 0; i < kAtOnce; ++i) {
      if (bit[i] < 0) break;
#pragma unroll
      for (int c = 0; c < kComponents; ++c) cells[bit[i] * kComponents + c] = StoredCellOf(args, sum[i][c]);
    }
  }
}

// Voxels of a lane's word where several triangles are of which some are among the largest. All lanes of a warp take each together.
template <int kComponents>
__device__ inline void FillSeveral(const SumRowArgs& args, const SumRowRoom<kComponents>& room, RowPart& part,
                                   const DrawnSpan<kComponents>& span, uint32_t small, uint32_t rank,
                                   uint32_t several) {
  for (uint32_t owners = __ballot_sync(~0u, several != 0); owners != 0; owners &= owners - 1) {
    const int owner = __ffs(int(owners)) - 1;
    const uint32_t of_owner = __shfl_sync(~0u, small, owner), first = __shfl_sync(~0u, rank, owner);
    for (uint32_t left = __shfl_sync(~0u, several, owner); left != 0; left &= left - 1) {
      const int bit = __ffs(int(left)) - 1, x = owner * 32 + bit;
      int64_t sum[kComponents] = {};
      if ((of_owner >> bit & 1) != 0) {
        const uint64_t of = first + uint32_t(__popc(of_owner & ((1u << bit) - 1)));
#pragma unroll
        for (int c = 0; c < kComponents; ++c) sum[c] = int64_t(args.store.from.sums[of * kComponents + unsigned(c)]);
      }
      for (uint32_t here = __ballot_sync(~0u, span.begin <= x && x < span.end); here != 0; here &= here - 1) {
        const int64_t(&term)[kComponents] = room.terms[__ffs(int(here)) - 1];
#pragma unroll
        for (int c = 0; c < kComponents; ++c) sum[c] = AddTerms(sum[c], term[c]);
      }
      if (threadIdx.x % 32 != 0) continue;
#pragma unroll
      for (int c = 0; c < kComponents; ++c) part.cells[x * kComponents + c] = StoredCellOf(args, sum[c]);
    }
  }
}

// Writes a part of a row. In: the voxels of the lane's word that small triangles cover, the first of which has the rank; where the part goes
// and its voxels; the lane's span. The word's coverage with that of all spans. All lanes of a warp call it.
template <int kComponents>
__device__ inline uint32_t StorePart(const SumRowArgs& args, const SumRowRoom<kComponents>& room, RowPart& part,
                                     uint32_t small, uint32_t rank, uint4* out, int voxels,
                                     const DrawnSpan<kComponents>& span) {
  const int lane = int(threadIdx.x % 32), units = voxels * kComponents / 4;
  const uint32_t clear = args.clear_stored;
  const bool drawn = __any_sync(~0u, span.begin < span.end) != 0;
  if (!drawn && __any_sync(~0u, small != 0) == 0) {
    for (int i = lane; i < units; i += 32) __stcs(out + i, uint4{clear, clear, clear, clear});
    return 0;
  }
  const uint32_t over = drawn ? DrawSpans(part, span, small) : 0;
  if (drawn) FillSeveral(args, room, part, span, small, rank, part.several[lane] & over);
  FillSmall<kComponents>(args, part, small, rank, small & ~over);
  __syncwarp();
  auto* const cells = reinterpret_cast<uint4*>(part.cells);
  for (int i = lane; i < units; i += 32) {
    const uint4 stored = cells[i];
    cells[i] = uint4{0, 0, 0, 0};
    __stcs(out + i, uint4{stored.x ^ clear, stored.y ^ clear, stored.z ^ clear, stored.w ^ clear});
  }
  __syncwarp();
  return small | over;
}

// The cells of a target. kIdShader: the shader of triangle ids.
template <int kComponents, int kIdShader>
__global__ void __launch_bounds__(kRowThreads, kRowBlocks) StoreSumRows(const __grid_constant__ SumRowArgs args) {
  using Room = SumRowRoom<kComponents>;
  __shared__ alignas(16) char memory[sizeof(Room)];
  auto& room = *reinterpret_cast<Room*>(memory);
  const unsigned lane = threadIdx.x % 32;
  RowPart& part = room.parts[threadIdx.x / 32];
  for (int i = int(lane); i < kRowCells; i += 32) part.cells[i] = 0;
  __syncwarp();
  const uint32_t large = SetUpLargest<kIdShader>(args, room);
  DrawnSpan<kComponents> span;
#pragma unroll
  for (int c = 0; c < kComponents; ++c) span.cells[c] = lane < large ? StoredCellOf(args, room.terms[lane][c]) : 0;
  const Ranks& ranks = args.store.ranks;
  const RowOrder parts(args.walk.grid, Room::kWords, kRowThreads / 32);
  const uint32_t warp = threadIdx.x / 32;
  const auto word_of = [&](const RowPartPlace& place) {
    return lane < place.words ? ranks.bits[place.word + lane] : 0;
  };
  uint64_t fragments = 0;
  // Coverage is read two parts ahead, and ranks one: memory is slow to answer while rows are stored.
  RowPartPlace place = parts.Find(blockIdx.x, warp), next = parts.Find(blockIdx.x + gridDim.x, warp);
  uint32_t word = word_of(place), next_word = word_of(next), rank = word != 0 ? ranks.first[place.word + lane] : 0;
  for (uint32_t item = blockIdx.x; item < parts.count; item += gridDim.x) {
    const uint32_t next_rank = next_word != 0 ? ranks.first[next.word + lane] : 0;
    const RowPartPlace after = parts.Find(item + 2 * gridDim.x, warp);
    const uint32_t word_after = word_of(after);
    if (place.words != 0) {
      int x_begin = 0, x_end = 0;
      if (lane < large) FindSpan(room.setups[lane], place, x_begin, x_end);
      if (place.x == 0) fragments += uint32_t(x_end - x_begin);
      const int width = int(place.words) * 32;
      span.begin = max(x_begin - place.x, 0);
      span.end = max(span.begin, min(x_end - place.x, width));
      auto* const out = reinterpret_cast<uint4*>(args.store.out) + place.word * (32 * kComponents / 4);
      const uint32_t all = StorePart(args, room, part, word, rank, out, width, span);
      if (args.coverage != nullptr && all != word) args.coverage[place.word + lane] = all;
    }
    place = next;
    word = next_word;
    rank = next_rank;
    next = after;
    next_word = word_after;
  }
  if (args.fragments != nullptr && large > 0) AddFragments(args.fragments, fragments);
}

}  // namespace voxelpipe::cuda
