// Accumulators of covered voxels, indexed by rank: the number of set bits before the voxel in a bit grid. The rank of
// the first set bit of each word is stored, so a lookup costs one population count. No host-only includes.
#pragma once

#include "cuda/coverage/accumulator_views.h"
#include "cuda/coverage/atomic_blend.cuh"

namespace voxelpipe::cuda {

inline constexpr int kBlendThreads = 256;

// Maps a covered voxel to its rank.
struct Ranks {
  const uint32_t* bits = nullptr;   // bit grid: voxels that triangles touch
  const uint32_t* first = nullptr;  // per word: rank of its first set bit

  // The rank of bit x of a word.
  __device__ uint32_t Of(uint32_t word, uint32_t x) const {
    return first[word] + uint32_t(__popc(bits[word] & ((1u << x) - 1)));
  }
};

__device__ inline uint32_t CombineCells(Kept kept, uint32_t a, uint32_t b) {
  return kept == Kept::kMax ? max(a, b) : kept == Kept::kMin ? min(a, b) : kept == Kept::kOr ? a | b : a & b;
}

// Adds the contribution of `count` triangles to the voxel with a rank.
template <int kComponents>
__device__ inline void AddAt(const Accumulators& to, uint64_t rank, const int64_t (&term)[kComponents],
                             uint32_t count) {
  if (to.kept == Kept::kAverage) atomicAdd(to.counts + rank, count);
#pragma unroll
  for (int c = 0; c < kComponents; ++c) {
    atomicAdd(to.sums + rank * kComponents + uint64_t(c), static_cast<unsigned long long>(term[c]));
  }
}
template <int kComponents>
__device__ inline void AddAt(const Accumulators& to, uint64_t rank, const uint32_t (&value)[kComponents],
                             uint32_t count) {
  const Kept kept = to.kept;
  if (kept == Kept::kCount) {
    atomicAdd(to.counts + rank, count);
    return;
  }
  uint32_t* const cells = to.cells + rank * kComponents;
  uint32_t now[kComponents];
  LookAtCells<kComponents>(cells, kept == Kept::kMin || kept == Kept::kAnd ? ~0u : 0, now);
#pragma unroll
  for (int c = 0; c < kComponents; ++c) {
    if (kept == Kept::kMax) {
      if (now[c] < value[c]) atomicMax(cells + c, value[c]);
    } else if (kept == Kept::kMin) {
      if (now[c] > value[c]) atomicMin(cells + c, value[c]);
    } else if (kept == Kept::kOr) {
      if ((now[c] & value[c]) != value[c]) atomicOr(cells + c, value[c]);
    } else {
      if ((now[c] & value[c]) != now[c]) atomicAnd(cells + c, value[c]);
    }
  }
}

// Component c of an accumulated value, in the target's format.
__device__ inline uint32_t StoredOf(const Accumulators& from, uint32_t rank, int c, VoxelFormat format, bool is_float,
                                    double quantum) {
  const uint64_t at = uint64_t{rank} * uint64_t(from.components) + uint64_t(c);
  switch (from.kept) {
    case Kept::kSum: return StoreSum(int64_t(from.sums[at]), format, quantum, c);
    case Kept::kAverage: return StoreAverage(int64_t(from.sums[at]), from.counts[rank], format, quantum, c);
    case Kept::kCount: return StoreCount(from.counts[rank], format);
    case Kept::kMin:
    case Kept::kMax: return StoredBits(is_float ? BitsOfKey(from.cells[at]) : from.cells[at], format);
    default: return StoredBits(from.cells[at], format);
  }
}

}  // namespace voxelpipe::cuda
