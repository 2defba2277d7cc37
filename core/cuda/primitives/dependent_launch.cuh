// Kernels that begin before the one before them on the stream has ended ("programmatic dependent launch", from compute
// capability 9.0 on; others begin as always). No host-only includes: they are launched by launch.cuh or kernel_list.h.
//
// A kernel launched so calls AwaitEarlier() in every thread before it touches what kernels before it on the stream
// write, or writes what they read; it never leaves that out, since the next one relies on it. It may begin once all
// blocks of the one before have called AllowNext() or ended; that one was launched plainly, or has the same from its
// own.
#pragma once

namespace voxelpipe::cuda {

__device__ inline void AwaitEarlier() {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
  asm volatile("griddepcontrol.wait;" ::: "memory");
#endif
}
__device__ inline void AllowNext() {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
  asm volatile("griddepcontrol.launch_dependents;" ::: "memory");
#endif
}

}  // namespace voxelpipe::cuda
