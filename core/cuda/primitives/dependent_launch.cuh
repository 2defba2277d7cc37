// Programmatic dependent launch: a kernel may start before the previous one on its stream has ended (compute capability
// 9.0; on older devices these functions do nothing). Launched by launch.cuh or kernel_list.h. No host-only includes.
//
// Contract: every thread of such a kernel calls AwaitEarlier() before it reads what earlier kernels of the stream
// write, or writes what they read. It must always call it, because the next kernel relies on it. The kernel may start
// once all blocks of the previous kernel have called AllowNext() or ended. The previous kernel is either an ordinary
// launch or follows the same contract.
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
