// What was blended by spans (span_blend.cuh) as values of the result; and ranks of covered voxels. Included by blend_store.cu only, as what
// includes it: these kernels are no templates. No host-only includes.
#pragma once

#include "cuda/span_blend.cuh"

namespace voxelpipe::cuda {

struct KeyArgs {
  const uint32_t* coverage;  // bit grid
  const uint32_t* negative;  // as InPlaceArgs has it
  uint32_t* out;
  uint64_t words, voxels;
  int64_t nx, words_per_row;
  int components;
  bool planar, complement, is_float;
};

// Four words of an array from number `at` on, a multiple of 4; those behind its end are 0.
__device__ inline uint4 FourWords(const uint32_t* array, uint64_t at, uint64_t words) {
  if (at + 4 <= words) return *reinterpret_cast<const uint4*>(array + at);
  uint4 four{0, 0, 0, 0};
  if (at < words) four.x = array[at];
  if (at + 1 < words) four.y = array[at + 1];
  if (at + 2 < words) four.z = array[at + 2];
  return four;
}

// Calls visit(word, x) for the set bits of a bit grid. A warp looks at 128 words at a time, for most are empty, and
// gives each bit a lane.
template <typename Visit>
__device__ inline void ForEachSetBit(const uint32_t* grid, uint64_t words, Visit&& visit) {
  const uint64_t warps = uint64_t(gridDim.x) * (kBlendThreads / 32);
  const unsigned lane = threadIdx.x % 32;
  for (uint64_t begin = (uint64_t(blockIdx.x) * (kBlendThreads / 32) + threadIdx.x / 32) * 128; begin < words;
       begin += warps * 128) {
    const uint64_t mine = begin + lane * 4;
    const uint4 four = FourWords(grid, mine, words);
    const int in_x = __popc(four.x), in_y = __popc(four.y), in_z = __popc(four.z);
    uint32_t total;
    const uint32_t first = WarpExclusiveSum(uint32_t(in_x + in_y + in_z + __popc(four.w)), total);
    for (uint32_t number = lane; number - lane < total; number += 32) {
      const int owner = LaneOfItem(first, number);
      int left = int(number - __shfl_sync(~0u, first, owner));
      const int a = __shfl_sync(~0u, in_x, owner), b = __shfl_sync(~0u, in_y, owner), c = __shfl_sync(~0u, in_z, owner);
      const uint32_t x = __shfl_sync(~0u, four.x, owner), y = __shfl_sync(~0u, four.y, owner);
      const uint32_t z = __shfl_sync(~0u, four.z, owner), w = __shfl_sync(~0u, four.w, owner);
      if (number >= total) continue;
      uint32_t bits = x;
      int which = 0;
      if (left >= a) bits = y, which = 1, left -= a;
      if (which == 1 && left >= b) bits = z, which = 2, left -= b;
      if (which == 2 && left >= c) bits = w, which = 3, left -= c;
      for (; left > 0; --left) bits &= bits - 1;
      visit(begin + uint64_t(owner) * 4 + uint64_t(which), unsigned(__ffs(int(bits)) - 1));
    }
  }
}

// The keys of covered voxels become values.
__global__ void __launch_bounds__(kBlendThreads) KeysToValues(const __grid_constant__ KeyArgs args) {
  const bool plain = args.negative != nullptr && *args.negative == 0;
  if (plain && !args.complement) return;
  ForEachSetBit(args.coverage, args.words, [&](uint64_t word, unsigned lane) {
    const uint64_t row = word / uint64_t(args.words_per_row), w = word % uint64_t(args.words_per_row);
    const uint64_t n = row * uint64_t(args.nx) + w * 32 + lane;
    for (uint64_t c = 0; c < uint64_t(args.components); ++c) {
      uint32_t* const cell = args.out + (args.planar ? c * args.voxels + n : n * uint64_t(args.components) + c);
      const uint32_t key = args.complement ? ~*cell : *cell;
      *cell = args.is_float && !plain ? BitsOfKey(key) : key;
    }
  });
}

inline constexpr int kRankedOfThread = 16;  // words

// Gives every set bit a rank, those of a word in a row; `counter` has the number of all.
__global__ void __launch_bounds__(kBlendThreads)
    RankWords(const uint32_t* bits, uint64_t words, uint32_t* first, uint64_t* counter) {
  constexpr int kEach = kRankedOfThread;
  __shared__ unsigned long long room[kBlendThreads / 32 + 1];
  const uint64_t begin = uint64_t(blockIdx.x) * (kBlendThreads * kEach) + threadIdx.x * 4;
  uint32_t word[kEach];
  uint32_t count = 0;
#pragma unroll
  for (int i = 0; i < kEach; i += 4) {
    const uint64_t at = begin + uint64_t(i) * kBlendThreads;
    const uint4 four = FourWords(bits, at, words);
    word[i] = four.x, word[i + 1] = four.y, word[i + 2] = four.z, word[i + 3] = four.w;
#pragma unroll
    for (int k = 0; k < 4; ++k) count += uint32_t(__popc(word[i + k]));
  }
  auto rank = uint32_t(BlockAllocate<kBlendThreads>(counter, count, room));
#pragma unroll
  for (int i = 0; i < kEach; ++i) {
    if (word[i] == 0) continue;
    first[begin + uint64_t(i / 4) * (4 * kBlendThreads) + uint64_t(i % 4)] = rank;
    rank += uint32_t(__popc(word[i]));
  }
}

struct StoreArgs {
  Ranks ranks;
  Accumulators from;
  VoxelFormat format{};
  bool is_float = false, planar = false;
  double quantum = 1;
  uint64_t words = 0;                // of the bit grid
  uint64_t voxels = 0;               // of the result
  const uint32_t* places = nullptr;  // by rank, a voxel's number in a sparse result; null: a dense one
  bool all = false;                  // every voxel of a sparse result has accumulators
  uint32_t nx = 0, words_per_row = 0;
  uint8_t* out = nullptr;
};

// What the accumulators of covered voxels hold becomes the result's values.
__global__ void __launch_bounds__(kBlendThreads) StoreAccumulated(const __grid_constant__ StoreArgs args) {
  const Accumulators& from = args.from;
  const auto store = [&](uint64_t rank, uint64_t n) {
    for (uint64_t c = 0; c < uint64_t(from.components); ++c) {
      const uint64_t at = rank * uint64_t(from.components) + c;
      uint32_t stored;
      switch (from.kept) {
        case Kept::kSum: stored = StoreSum(int64_t(from.sums[at]), args.format, args.quantum); break;
        case Kept::kAverage:
          stored = StoreAverage(int64_t(from.sums[at]), from.counts[rank], args.format, args.quantum);
          break;
        case Kept::kCount: stored = StoreCount(from.counts[rank], args.format); break;
        case Kept::kMin:
        case Kept::kMax:
          stored = StoredBits(args.is_float ? BitsOfKey(from.cells[at]) : from.cells[at], args.format);
          break;
        default: stored = StoredBits(from.cells[at], args.format);
      }
      const uint64_t to = args.planar ? c * args.voxels + n : n * uint64_t(from.components) + c;
      switch (args.format) {
        case VoxelFormat::kU8: args.out[to] = uint8_t(stored); break;
        case VoxelFormat::kU16:
        case VoxelFormat::kF16: reinterpret_cast<uint16_t*>(args.out)[to] = uint16_t(stored); break;
        default: reinterpret_cast<uint32_t*>(args.out)[to] = stored; break;
      }
    }
  };
  if (args.all) {
    const uint64_t threads = uint64_t(gridDim.x) * kBlendThreads;
    for (uint64_t i = uint64_t(blockIdx.x) * kBlendThreads + threadIdx.x; i < args.voxels; i += threads)
      store(i, args.places[i]);
    return;
  }
  ForEachSetBit(args.ranks.bits, args.words, [&](uint64_t word, unsigned x) {
    if (args.places != nullptr) {
      const uint32_t rank = args.ranks.Of<RankedBy::kRows>(uint32_t(word), x);
      store(rank, args.places[rank]);
    } else {
      store(args.ranks.Of<RankedBy::kWords>(uint32_t(word), x),
            VoxelOfBit(uint32_t(word) * 32 + x, args.nx, args.words_per_row));
    }
  });
}

}  // namespace voxelpipe::cuda
