// Sums and bounds over a warp, on every architecture that is built for. No host-only includes.
#pragma once

#include <cstdint>

namespace voxelpipe::cuda {

// All lanes of the warp call it, and all get the sum.
__device__ inline uint32_t WarpSum(uint32_t value) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ < 800  // the instruction came with compute capability 8.0
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

// The least and the largest; likewise.
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

// The bits of the lanes before this one.
__device__ inline uint32_t LanesBefore() {
#if defined(__CUDA_ARCH__)
  uint32_t lanes;
  asm volatile("mov.u32 %0, %%lanemask_lt;" : "=r"(lanes));
  return lanes;
#else
  return (1u << threadIdx.x % 32) - 1;
#endif
}

// The box of what the lanes with `has` bring, `from` to `last` along each axis, none below 0: its first place, ~0 where
// no lane has any, and its size; likewise.
__device__ inline void WarpBox(bool has, const uint32_t (&from)[3], const uint32_t (&last)[3], uint32_t (&least)[3],
                               uint32_t (&size)[3]) {
#pragma unroll
  for (int a = 0; a < 3; ++a) {
    least[a] = WarpLeast(has ? from[a] : ~0u);
    size[a] = WarpLargest(has ? last[a] : 0u) + 1 - least[a];
  }
}

// The sum over the lanes up to this one; likewise.
template <typename T>
__device__ inline T SumUpto(T value) {
  const unsigned lane = threadIdx.x % 32;
  for (unsigned step = 1; step < 32; step *= 2) {
    const T below = __shfl_up_sync(~0u, value, step);
    if (lane >= step) value += below;
  }
  return value;
}

// Of what the warps of a block have brought to shared memory, the sum over those before this one, and over all. A
// barrier lies between.
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
