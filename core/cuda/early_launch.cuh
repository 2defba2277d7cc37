// Kernels that begin before the one before them on the stream has ended ("programmatic dependent launch", from compute capability 9.0 on;
// others begin as always). Included by .cu files only.
//
// A kernel launched so calls AwaitEarlier() in every thread before it touches what kernels before it on the stream write, or writes what
// they read; it never leaves that out, since the next one relies on it. It may begin once all blocks of the one before have
// called AllowNext() or ended; that one was launched plainly, or has the same from its own.
#pragma once

#include <cuda_runtime_api.h>

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

// `early`: whether the device can. Errors as with any launch: cudaGetLastError() has them.
template <typename... Parameters>
void LaunchEarly(bool early, cudaStream_t stream, dim3 blocks, unsigned threads, void (*kernel)(Parameters...),
                 const Parameters&... arguments) {
  cudaLaunchAttribute attribute{};
  attribute.id = cudaLaunchAttributeProgrammaticStreamSerialization;
  attribute.val.programmaticStreamSerializationAllowed = 1;
  const cudaLaunchConfig_t config{blocks, dim3(threads), 0, stream, &attribute, early ? 1u : 0u};
  (void)cudaLaunchKernelEx(&config, kernel, arguments...);
}

}  // namespace voxelpipe::cuda
