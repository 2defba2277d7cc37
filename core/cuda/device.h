// The CUDA device that this process works on.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace voxelpipe::cuda {

struct DeviceInfo {
  int ordinal = 0;
  std::string name;
  int multiprocessors = 1;
  uint64_t shared_bytes_per_block = 0;  // with the opt-in
  uint64_t memory_bytes = 0;
};

// The first device, its memory pool set to keep what it has. Found once a process. FAILED_PRECONDITION saying why there is none:
// no driver, no device, a device too old for the compiled code, or one that was lost.
absl::StatusOr<DeviceInfo> TheDevice();

// Called where an error leaves the device unusable for this process; TheDevice fails from then on, naming `reason`.
void MarkDeviceLost(std::string_view reason);

}  // namespace voxelpipe::cuda
