// Accumulators of covered voxels, numbered by rank: the set bits before a voxel's in a bit grid. A word of the grid has
// the rank of its first set bit, so that a rank costs one population count. No host-only includes.
#pragma once

#include "cuda/coverage/atomic_blend.cuh"

namespace voxelpipe::cuda {

inline constexpr int kBlendThreads = 256;

// Where a covered voxel's accumulators are: its rank, the number of covered voxels before it.
struct Ranks {
  const uint32_t* bits = nullptr;   // bit grid: voxels that some triangle touches
  const uint32_t* first = nullptr;  // rank of the first voxel of a word

  // Of a voxel, x of a word.
  __device__ uint32_t Of(uint32_t word, uint32_t x) const {
    return first[word] + uint32_t(__popc(bits[word] & ((1u << x) - 1)));
  }
};

// Accumulators by rank, `components` a voxel; those that the target's Kept needs.
struct Accumulators {
  Kept kept{};
  int components = 1;
  uint32_t* cells = nullptr;
  unsigned long long* sums = nullptr;
  uint32_t* counts = nullptr;  // one a voxel
};

__device__ inline uint32_t CombineCells(Kept kept, uint32_t a, uint32_t b) {
  return kept == Kept::kMax ? max(a, b) : kept == Kept::kMin ? min(a, b) : kept == Kept::kOr ? a | b : a & b;
}

// Adds what `count` triangles bring to the voxel with a rank.
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

// Four words of an array from number `at` on, a multiple of 4; those behind its end are 0.
__device__ inline uint4 FourWords(const uint32_t* array, uint64_t at, uint64_t words) {
  if (at + 4 <= words) return *reinterpret_cast<const uint4*>(array + at);
  uint4 four{0, 0, 0, 0};
  if (at < words) four.x = array[at];
  if (at + 1 < words) four.y = array[at + 1];
  if (at + 2 < words) four.z = array[at + 2];
  return four;
}

}  // namespace voxelpipe::cuda
