// Capabilities of a device and of the code compiled for it. Queried once per process; thread-safe.
#pragma once

#include <array>
#include <atomic>

#include "cuda/device/device.h"

namespace voxelpipe::cuda {

// Per-device cache of a non-negative value: calls `find` the first time.
template <typename Find>
int OfDevice(std::array<std::atomic<int>, 64>& known, const DeviceInfo& device, Find&& find) {
  std::atomic<int>& slot = known[size_t(device.ordinal) % known.size()];  // the value + 1; 0: not known yet
  if (const int found = slot.load(std::memory_order_relaxed); found > 0) return found - 1;
  const int value = find();
  slot.store(value + 1, std::memory_order_relaxed);
  return value;
}

// True if kernels support programmatic dependent launch (dependent_launch.cuh). It depends on the architecture that
// they were compiled for: a newer device may run code compiled for an older one.
bool BeginsEarly(const DeviceInfo& device);
// Size of the L2 cache in bytes, or the assumed one (AssumeCache); 0 if unknown.
uint64_t CacheBytes(const DeviceInfo& device);
// True if `bytes` exceed half of the L2 cache. False if its size is unknown.
bool ExceedsCache(const DeviceInfo& device, uint64_t bytes);

}  // namespace voxelpipe::cuda
