// What a device and the code compiled for it can do. Asked of the driver once a process; thread-safe.
#pragma once

#include <array>
#include <atomic>

#include "cuda/device/device.h"

namespace voxelpipe::cuda {

// The first value that `find` gives for a device, a number not below 0.
template <typename Find>
int OfDevice(std::array<std::atomic<int>, 64>& known, const DeviceInfo& device, Find&& find) {
  std::atomic<int>& slot = known[size_t(device.ordinal) % known.size()];  // one more than found
  if (const int found = slot.load(std::memory_order_relaxed); found > 0) return found - 1;
  const int value = find();
  slot.store(value + 1, std::memory_order_relaxed);
  return value;
}

// Whether kernels can begin before the one before them has ended (dependent_launch.cuh): only where they were compiled for
// an architecture that lets them wait. A device that can may run code of an older one.
bool BeginsEarly(const DeviceInfo& device);
// Whether the L2 cache holds less than the most of so many bytes; false where its size is unknown.
bool ExceedsCache(const DeviceInfo& device, uint64_t bytes);

}  // namespace voxelpipe::cuda
