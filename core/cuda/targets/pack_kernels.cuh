// Packs bit grids to bits without padding between rows, and counts set bits. No host-only includes.
#pragma once

#include "cuda/primitives/views.h"

namespace voxelpipe::cuda {

struct PackArgs {
  const uint32_t *present, *value, *inside;  // bit grids; inside may be null
  uint32_t clear, fill;                      // all bits set or none
  int64_t nx, words_per_row;
  uint64_t voxels;
  uint32_t* out;
};

// The result bits of the 32 voxels of a row's word.
__device__ inline uint32_t ValueWord(const PackArgs& a, uint64_t word) {
  const uint32_t here = a.present[word], inside = a.inside == nullptr ? 0 : a.inside[word];
  const uint32_t elsewhere = (inside & a.fill) | (~inside & a.clear);
  return (here & a.value[word]) | (~here & elsewhere);
}

// Word w of the packed bits, gathered from the rows that it spans.
__device__ inline uint32_t PackedWord(const PackArgs& a, uint64_t w) {
  uint32_t packed = 0;
  uint64_t row = w * 32 / uint64_t(a.nx);
  int64_t x = int64_t(w * 32 - row * uint64_t(a.nx));
  int filled = 0;
  while (filled < 32 && row * uint64_t(a.nx) < a.voxels) {
    const uint64_t word = row * uint64_t(a.words_per_row) + uint64_t(x / 32);
    const int offset = int(x % 32);
    const int64_t rest = a.nx - x;
    const int take = int(min(min(int64_t(32 - offset), rest), int64_t(32 - filled)));
    const uint32_t bits = ValueWord(a, word) >> offset & (take == 32 ? ~0u : (1u << take) - 1);
    packed |= bits << filled;
    filled += take;
    x += take;
    if (x == a.nx) {
      x = 0;
      ++row;
    }
  }
  return packed;
}

// Adds the number of set bits of `a`, or of `a | b`, in words begin, begin + step, ... to a counter. All threads of a
// warp call it.
__device__ inline void AddBits(const uint32_t* a, const uint32_t* b, uint64_t words, uint64_t begin, uint64_t step,
                               uint64_t* counter) {
  uint64_t sum = 0;
  for (uint64_t i = begin; i < words; i += step) sum += unsigned(__popc(b == nullptr ? a[i] : a[i] | b[i]));
  for (int by = 16; by > 0; by /= 2) sum += __shfl_down_sync(~0u, sum, by);
  if (threadIdx.x % 32 == 0 && sum > 0) atomicAdd(reinterpret_cast<unsigned long long*>(counter), sum);
}

}  // namespace voxelpipe::cuda
