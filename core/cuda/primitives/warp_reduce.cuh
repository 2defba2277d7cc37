// Reductions and prefix sums over a warp, for every architecture that is built for. No host-only includes.
#pragma once

#include <cstdint>

namespace voxelpipe::cuda {

// The sum over the warp, in all lanes. All lanes call it.
__device__ inline uint32_t WarpSum(uint32_t value) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ < 800  // the instruction requires compute capability 8.0
  for (int step = 16; step > 0; step /= 2) value += __shfl_xor_sync(~0u, value, step);
  return value;
#else
  return __reduce_add_sync(~0u, value);
#endif
}
__device__ inline uint64_t WarpSum(uint64_t value) {
  for (int step = 16; step > 0; step /= 2) value += __shfl_xor_sync(~0u, value, step);
  return value;
}

// The minimum and the maximum over the warp, in all lanes. All lanes call them.
__device__ inline uint32_t WarpLeast(uint32_t value) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ < 800
  for (int step = 16; step > 0; step /= 2) value = min(value, __shfl_xor_sync(~0u, value, step));
  return value;
#else
  return __reduce_min_sync(~0u, value);
#endif
}
__device__ inline uint32_t WarpLargest(uint32_t value) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ < 800
  for (int step = 16; step > 0; step /= 2) value = max(value, __shfl_xor_sync(~0u, value, step));
  return value;
#else
  return __reduce_max_sync(~0u, value);
#endif
}

// Mask of the lanes before this one.
__device__ inline uint32_t LanesBefore() {
#if defined(__CUDA_ARCH__)
  uint32_t lanes;
  asm volatile("mov.u32 %0, %%lanemask_lt;" : "=r"(lanes));
  return lanes;
#else
  return (1u << threadIdx.x % 32) - 1;
#endif
}

// Bounding box over the lanes with `has` of boxes `from` to `last` (inclusive, non-negative): its minimum corner, ~0 if
// no lane has one, and its size. All lanes call it.
__device__ inline void WarpBox(bool has, const uint32_t (&from)[3], const uint32_t (&last)[3], uint32_t (&least)[3],
                               uint32_t (&size)[3]) {
#pragma unroll
  for (int a = 0; a < 3; ++a) {
    least[a] = WarpLeast(has ? from[a] : ~0u);
    size[a] = WarpLargest(has ? last[a] : 0u) + 1 - least[a];
  }
}

// Inclusive prefix sum over the lanes. All lanes call it.
template <typename T>
__device__ inline T SumUpto(T value) {
  const unsigned lane = threadIdx.x % 32;
  for (unsigned step = 1; step < 32; step *= 2) {
    const T below = __shfl_up_sync(~0u, value, step);
    if (lane >= step) value += below;
  }
  return value;
}

// Sum of `sums` over the warps before this one, and over all (`all`). `sums` is in shared memory, with one element per
// warp, written before a barrier.
template <typename T, int kWarps>
__device__ inline T SumOfWarps(const T (&sums)[kWarps], T& all) {
  T before = all = 0;
#pragma unroll
  for (int w = 0; w < kWarps; ++w) {
    if (w == int(threadIdx.x / 32)) before = all;
    all += sums[w];
  }
  return before;
}

}  // namespace voxelpipe::cuda
