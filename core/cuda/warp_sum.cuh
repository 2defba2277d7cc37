// The sum over a warp, on every architecture that is built for. No host-only includes.
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

}  // namespace voxelpipe::cuda
