// Asynchronous copy of device counters to the host, concurrent with later work of the same stream.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "absl/status/statusor.h"
#include "cuda/device/device.h"
#include "cuda/device/pinned.h"

namespace voxelpipe::cuda {

// Copies counters once the work queued on a stream so far is done. The copy runs on a second stream: between kernels of
// one stream it would delay the following kernels by about 10 us. The destructor waits for the copy.
class CounterCopy {
 public:
  // No kernel may write the counters until Wait returns.
  static absl::StatusOr<CounterCopy> Start(const uint64_t* counters, uint64_t count, int ordinal, cudaStream_t stream);

  // Waits for the copy, not for work queued on the stream since Start. The counters must outlive this object.
  absl::StatusOr<const uint64_t*> Wait() const;

 private:
  CounterCopy(PinnedBuffer&& to, DeviceUse&& use) : to_(std::move(to)), use_(std::move(use)) {}

  PinnedBuffer to_;
  DeviceUse use_;
};

}  // namespace voxelpipe::cuda
