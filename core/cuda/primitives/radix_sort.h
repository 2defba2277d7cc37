// Stable radix sort of 32-bit key-value pairs. Wraps CUB, whose instances compile slowly, in one translation unit.
#pragma once

#include <cstdint>

#include "absl/status/statusor.h"
#include "cuda/device/buffer.h"

namespace voxelpipe::cuda {

// Double buffers of keys and values: one copy holds the data, the other is scratch of the same size.
struct KeyValueArrays {
  uint32_t* keys[2] = {};
  uint32_t* values[2] = {};
  uint64_t count = 0;
};

// Stably sorts the first copy by the lowest `bits` bits of its keys. Resizes `scratch` and overwrites it. Returns the
// copy that holds the sorted elements, 0 or 1.
absl::StatusOr<int> SortByKey(const KeyValueArrays& arrays, int bits, DeviceArray<uint8_t>& scratch,
                              cudaStream_t stream);

}  // namespace voxelpipe::cuda
