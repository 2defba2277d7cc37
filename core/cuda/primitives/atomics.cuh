// Atomic operations. Reductions on global memory (no return value) are written as PTX `red`: in a kernel that contains
// a fence the compiler emits `atom` instead, and kernels that set bits take up to a third longer. No host-only
// includes.
#pragma once

#include <cstdint>

namespace voxelpipe::cuda {

__device__ inline void ReduceOr(uint32_t* to, uint32_t bits) {
#if defined(__CUDA_ARCH__)
  asm volatile("red.relaxed.gpu.global.or.b32 [%0], %1;" ::"l"(__cvta_generic_to_global(to)), "r"(bits) : "memory");
#else  // host emulator
  atomicOr(to, bits);
#endif
}

__device__ inline void ReduceMax(uint32_t* to, uint32_t value) {
#if defined(__CUDA_ARCH__)
  asm volatile("red.relaxed.gpu.global.max.u32 [%0], %1;" ::"l"(__cvta_generic_to_global(to)), "r"(value) : "memory");
#else  // host emulator
  atomicMax(to, value);
#endif
}

// Adds to a counter in shared memory and returns its previous value. Called by one lane of a warp. Inline PTX, because
// the compiler does not know that and would add warp aggregation.
__device__ inline uint32_t SharedAdd(uint32_t* to, uint32_t value) {
#if defined(__CUDA_ARCH__)
  uint32_t before;
  asm volatile("atom.shared.add.u32 %0, [%1], %2;"
               : "=r"(before)
               : "r"(uint32_t(__cvta_generic_to_shared(to))), "r"(value)
               : "memory");
  return before;
#else  // host emulator
  return atomicAdd(to, value);
#endif
}

// A shared-memory address, and its conversion from a pointer.
#if defined(__CUDA_ARCH__)
using SharedPlace = uint32_t;
__device__ inline SharedPlace PlaceOf(const void* p) {
  return uint32_t(__cvta_generic_to_shared(p));
}
#else  // host emulator
using SharedPlace = uintptr_t;
__device__ inline SharedPlace PlaceOf(const void* p) {
  return reinterpret_cast<uintptr_t>(p);
}
#endif
// Sets bits of the word at a shared-memory address.
__device__ inline void SharedOr(SharedPlace to, uint32_t bits) {
#if defined(__CUDA_ARCH__)
  asm volatile("red.shared.or.b32 [%0], %1;" ::"r"(to), "r"(bits) : "memory");
#else  // host emulator
  atomicOr(reinterpret_cast<uint32_t*>(to), bits);
#endif
}

// Sets all bits of a word by a plain store. Safe beside concurrent ReduceOr: all bits are set afterwards, in either
// order.
__device__ inline void SetAllBits(uint32_t* to) {
#if defined(__CUDA_ARCH__)
  *to = ~0u;
#else  // host emulator, which detects races
  __stcg(to, ~0u);
#endif
}

// Sets a flag that other threads may set at the same time.
__device__ inline void SetMark(uint8_t* to) {
#if defined(__CUDA_ARCH__)
  *to = 1;
#else  // host emulator, which detects races
  __stcg(to, uint8_t{1});
#endif
}

// Sets bits of a word in shared memory. Reads it first, since they are usually set already.
__device__ inline void OrIfMissing(uint32_t* to, uint32_t bits) {
  if ((*static_cast<volatile uint32_t*>(to) & bits) != bits) atomicOr(to, bits);
}

}  // namespace voxelpipe::cuda
