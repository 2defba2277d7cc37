// Grid sizes, and programmatic dependent launches. Included by .cu files only.
#pragma once

#include <cuda_runtime_api.h>

#include <algorithm>
#include <cstdint>

namespace voxelpipe::cuda {

// Number of blocks for `count` work items, `each` of them per block; at least 1, at most `most`. Beyond that, kernels
// process further items in grid-stride loops.
inline unsigned BlocksFor(uint64_t count, uint64_t each, uint64_t most = 1 << 16) {
  return unsigned(std::clamp<uint64_t>((count + each - 1) / each, 1, most));
}

// Triangles per thread for kernels whose blocks take `rounds` * `threads` triangles, with `resident` blocks on the
// device at a time. Chooses the number up to `most` that leaves the smallest tail in the last wave of blocks. With few
// waves the tail dominates; with many waves blocks get out of step and the maximum is best.
inline int RoundsFor(uint64_t triangles, int threads, uint64_t resident, int most) {
  constexpr uint64_t kManyWaves = 8;
  if (triangles >= kManyWaves * resident * uint64_t(threads) * uint64_t(most)) return most;
  int best = 1;
  uint64_t least = UINT64_MAX;
  for (int rounds = most; rounds >= 1; --rounds) {
    const uint64_t each = uint64_t(rounds) * uint64_t(threads), blocks = (triangles + each - 1) / each;
    const uint64_t waves = (blocks + resident - 1) / resident, work = 4 * waves * uint64_t(rounds) + waves;
    if (work < least) {
      least = work;
      best = rounds;
    }
  }
  return best;
}

// Launches a kernel that follows dependent_launch.cuh, with `room` bytes of dynamic shared memory. `early`: the device
// supports programmatic dependent launch. cudaGetLastError() returns the errors, as for any launch.
template <typename... Parameters>
void LaunchEarly(bool early, cudaStream_t stream, dim3 blocks, unsigned threads, size_t room,
                 void (*kernel)(Parameters...), const Parameters&... arguments) {
  cudaLaunchAttribute attribute{};
  attribute.id = cudaLaunchAttributeProgrammaticStreamSerialization;
  attribute.val.programmaticStreamSerializationAllowed = 1;
  const cudaLaunchConfig_t config{blocks, dim3(threads), room, stream, &attribute, early ? 1u : 0u};
  (void)cudaLaunchKernelEx(&config, kernel, arguments...);
}
template <typename... Parameters>
void LaunchEarly(bool early, cudaStream_t stream, dim3 blocks, unsigned threads, void (*kernel)(Parameters...),
                 const Parameters&... arguments) {
  LaunchEarly(early, stream, blocks, threads, 0, kernel, arguments...);
}

}  // namespace voxelpipe::cuda
