// Acquire loads and release adds on global memory, to synchronize blocks of a running kernel. A thread that reads a
// word by an acquire sees everything that was written before the matching release, transitively. Cheaper than
// __threadfence(), which orders more. No host-only includes.
#pragma once

#include <cstdint>

namespace voxelpipe::cuda {

// Relaxed accesses to words that other threads access concurrently. They order nothing else.
__device__ inline uint32_t LoadRelaxed(const uint32_t* from) {
  return *const_cast<const volatile uint32_t*>(from);
}
__device__ inline void StoreRelaxed(uint32_t* to, uint32_t value) {
  *const_cast<volatile uint32_t*>(to) = value;
}

__device__ inline uint32_t LoadAcquire(const uint32_t* from) {
#if defined(__CUDA_ARCH__)
  uint32_t value;
  asm volatile("ld.acquire.gpu.global.u32 %0, [%1];" : "=r"(value) : "l"(__cvta_generic_to_global(from)) : "memory");
  return value;
#else  // host emulator
  const uint32_t value = LoadRelaxed(from);
  __threadfence();
  return value;
#endif
}

__device__ inline void AddRelease(uint32_t* to, uint32_t value) {
#if defined(__CUDA_ARCH__)
  asm volatile("red.release.gpu.global.add.u32 [%0], %1;" ::"l"(__cvta_generic_to_global(to)), "r"(value) : "memory");
#else  // host emulator
  __threadfence();
  atomicAdd(to, value);
#endif
}

}  // namespace voxelpipe::cuda
