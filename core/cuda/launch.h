// How many blocks a launch takes, and launches that begin early. Included by .cu files only.
#pragma once

#include <cuda_runtime_api.h>

#include <algorithm>
#include <cstdint>

namespace voxelpipe::cuda {

// Blocks for `count` pieces of work, `each` of them a block; at least one, and at most `most`, whose threads then take further pieces in
// strides of the grid.
inline unsigned BlocksFor(uint64_t count, uint64_t each, uint64_t most = 1 << 16) {
  return unsigned(std::clamp<uint64_t>((count + each - 1) / each, 1, most));
}

// Launches a kernel that keeps to early_launch.cuh. `early`: whether the device can. Errors as with any launch: cudaGetLastError() has them.
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
