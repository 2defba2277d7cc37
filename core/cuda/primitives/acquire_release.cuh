// Words of global memory by which blocks that run at the same time tell each other what is done: what a thread wrote
// before a release, and what threads wrote whom it had waited for, whoever reads that word by an acquire finds written.
// They take less time than fences, which order more. No host-only includes.
#pragma once

#include <cstdint>

namespace voxelpipe::cuda {

// Words that others read or write at the same time, and no more than that.
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
#else  // on the host
  const uint32_t value = LoadRelaxed(from);
  __threadfence();
  return value;
#endif
}

__device__ inline void AddRelease(uint32_t* to, uint32_t value) {
#if defined(__CUDA_ARCH__)
  asm volatile("red.release.gpu.global.add.u32 [%0], %1;" ::"l"(__cvta_generic_to_global(to)), "r"(value) : "memory");
#else  // on the host
  __threadfence();
  atomicAdd(to, value);
#endif
}

}  // namespace voxelpipe::cuda
