// Prefix sum over the blocks of a running kernel, in a single pass. No host-only includes.
//
// Source: D. Merrill and M. Garland, "Single-pass Parallel Prefix Scan with Decoupled Look-back", NVIDIA 2016.
#pragma once

#include <cstdint>

#include "cuda/primitives/warp_reduce.cuh"

namespace voxelpipe::cuda {

// Every block publishes in its element of `said` first its own sum `here`, later the inclusive prefix sum, which it
// finds by summing backwards to the nearest block that has published one. Sums have at most 62 bits. `said` must be 0
// before and used for nothing else. Blocks start in the order of their numbers, or take numbers (`block`) in the order
// in which they start. The first warp of every block calls both functions; the earlier it calls the first, the less
// others wait in the second.
inline constexpr uint64_t kSaysHere = uint64_t{1} << 62, kSaysUpto = uint64_t{1} << 63;

__device__ inline void SayHere(uint64_t* said, uint64_t here, uint32_t block) {
  volatile uint64_t* const mine = said + block;
  if (threadIdx.x == 0) *mine = (block == 0 ? uint64_t{kSaysUpto} : uint64_t{kSaysHere}) | here;
}

// Returns the sum over the blocks before this one.
__device__ inline uint64_t LookBack(uint64_t* said, uint64_t here, uint32_t block) {
  if (block == 0) return 0;
  const unsigned lane = threadIdx.x % 32;
  volatile uint64_t* const all = said;
  uint64_t sum = 0;
  for (int64_t at = int64_t(block) - 1 - lane;; at -= 32) {
    uint64_t there;
    unsigned nearest;  // the nearest lane that sees an inclusive prefix; the largest number if none does
    do {
      there = at < 0 ? uint64_t{kSaysUpto} : all[at];
      nearest = unsigned(__ffs(int(__ballot_sync(~0u, (there & kSaysUpto) != 0))) - 1);
    } while (__any_sync(~0u, there == 0 && lane <= nearest) != 0);
    sum += WarpSum(lane <= nearest ? there & (kSaysHere - 1) : uint64_t{0});
    if (nearest < 32) break;
  }
  if (lane == 0) all[block] = kSaysUpto | (sum + here);
  return sum;
}

__device__ inline void SayHere(uint64_t* said, uint64_t here) {
  SayHere(said, here, blockIdx.x);
}
__device__ inline uint64_t LookBack(uint64_t* said, uint64_t here) {
  return LookBack(said, here, blockIdx.x);
}

}  // namespace voxelpipe::cuda
