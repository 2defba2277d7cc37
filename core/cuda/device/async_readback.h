// Counters on their way to the host while the stream goes on.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "absl/status/statusor.h"
#include "cuda/device/device.h"
#include "cuda/device/pinned.h"

namespace voxelpipe::cuda {

// A copy of counters as they are when the stream's work so far is done, on a stream of its own: a copy amid kernels
// keeps those behind it waiting for some 10 us. At its end it waits for the copy.
class CounterCopy {
 public:
  // Nothing writes the counters until Wait returns.
  static absl::StatusOr<CounterCopy> Start(const uint64_t* counters, uint64_t count, int ordinal, cudaStream_t stream);

  // Waits for the copy, not for what the stream got since. The counters live as long as this does.
  absl::StatusOr<const uint64_t*> Wait() const;

 private:
  CounterCopy(PinnedBuffer&& to, DeviceUse&& use) : to_(std::move(to)), use_(std::move(use)) {}

  PinnedBuffer to_;
  DeviceUse use_;
};

}  // namespace voxelpipe::cuda
