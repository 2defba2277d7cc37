// Atomic operations. Those on global memory that give no answer are written out: in a kernel that has a fence somewhere
// the compiler takes ones that give one, and walks that set bits then take up to a third longer. No host-only includes.
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

// Adds to a counter in shared memory: what it was. By one lane of a warp, which the compiler does not know: it would
// have lanes agree on one.
__device__ inline uint32_t SharedAdd(uint32_t* to, uint32_t value) {
#if defined(__CUDA_ARCH__)
  uint32_t before;
  asm volatile("atom.shared.add.u32 %0, [%1], %2;"
               : "=r"(before)
               : "r"(uint32_t(__cvta_generic_to_shared(to))), "r"(value)
               : "memory");
  return before;
#else  // on the host
  return atomicAdd(to, value);
#endif
}

// Where something lies in shared memory, in bytes.
#if defined(__CUDA_ARCH__)
using SharedPlace = uint32_t;
__device__ inline SharedPlace PlaceOf(const void* p) {
  return uint32_t(__cvta_generic_to_shared(p));
}
#else  // on the host
using SharedPlace = uintptr_t;
__device__ inline SharedPlace PlaceOf(const void* p) {
  return reinterpret_cast<uintptr_t>(p);
}
#endif
// Sets bits of the word there.
__device__ inline void SharedOr(SharedPlace to, uint32_t bits) {
#if defined(__CUDA_ARCH__)
  asm volatile("red.shared.or.b32 [%0], %1;" ::"r"(to), "r"(bits) : "memory");
#else  // on the host
  atomicOr(reinterpret_cast<uint32_t*>(to), bits);
#endif
}

// Sets all bits of a word by a plain store: behind it and whatever ReduceOr sets at the same time they are all set, in
// either order.
__device__ inline void SetAllBits(uint32_t* to) {
#if defined(__CUDA_ARCH__)
  *to = ~0u;
#else  // on the host, where races are looked for
  __stcg(to, ~0u);
#endif
}

// A mark that others set at the same time, too.
__device__ inline void SetMark(uint8_t* to) {
#if defined(__CUDA_ARCH__)
  *to = 1;
#else  // on the host, where races are looked for
  __stcg(to, uint8_t{1});
#endif
}

// Sets bits of a word in shared memory, which most often are set: that is looked at first.
__device__ inline void OrIfMissing(uint32_t* to, uint32_t bits) {
  if ((*static_cast<volatile uint32_t*>(to) & bits) != bits) atomicOr(to, bits);
}

}  // namespace voxelpipe::cuda
