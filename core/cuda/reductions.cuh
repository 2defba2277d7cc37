// Atomic operations on global memory that give no answer, written out: in a kernel that has a fence somewhere the compiler takes those that
// give one, and walks that set bits then take up to a third longer. No host-only includes.
#pragma once

#include <cstdint>

namespace voxelpipe::cuda {

__device__ inline void ReduceOr(uint32_t* to, uint32_t bits) {
#if defined(__CUDA_ARCH__)
  asm volatile("red.relaxed.gpu.global.or.b32 [%0], %1;" ::"l"(__cvta_generic_to_global(to)), "r"(bits) : "memory");
#else  // on the host
  atomicOr(to, bits);
#endif
}

__device__ inline void ReduceMax(uint32_t* to, uint32_t value) {
#if defined(__CUDA_ARCH__)
  asm volatile("red.relaxed.gpu.global.max.u32 [%0], %1;" ::"l"(__cvta_generic_to_global(to)), "r"(value) : "memory");
#else  // on the host
  atomicMax(to, value);
#endif
}

}  // namespace voxelpipe::cuda
