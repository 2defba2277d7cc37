// Copies counters to pinned memory on a second stream that is ordered after the first.
#include "cuda/device/async_readback.h"

#include <utility>

#include "cuda/device/check.h"

namespace voxelpipe::cuda {

absl::StatusOr<CounterCopy> CounterCopy::Start(const uint64_t* counters, uint64_t count, int ordinal,
                                               cudaStream_t stream) {
  const uint64_t bytes = count * sizeof(uint64_t);
  absl::StatusOr<PinnedBuffer> to = PinnedBuffer::Take(bytes);
  if (!to.ok()) return to.status();
  absl::StatusOr<DeviceUse> use = DeviceUse::Begin(ordinal);
  if (!use.ok()) return use.status();
  CounterCopy copy(*std::move(to), *std::move(use));
  VOXELPIPE_OK_OR_RETURN(copy.use_.After(stream));
  VOXELPIPE_CUDA_OR_RETURN(
      cudaMemcpyAsync(copy.to_.data(), counters, bytes, cudaMemcpyDeviceToHost, copy.use_.stream()));
  return copy;
}

absl::StatusOr<const uint64_t*> CounterCopy::Wait() const {
  VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(use_.stream()));
  return reinterpret_cast<const uint64_t*>(to_.data());
}

}  // namespace voxelpipe::cuda
