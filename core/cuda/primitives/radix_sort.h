// A stable radix sort of keys with 32-bit values: CUB's, whose instances compile slowly and stand in one place.
#pragma once

#include <cstdint>

#include "absl/status/statusor.h"
#include "cuda/device/buffer.h"

namespace voxelpipe::cuda {

// Two copies of an array of keys and of their values: one holds them, the other is as large.
struct KeyValueArrays {
  uint32_t* keys[2] = {};
  uint32_t* values[2] = {};
  uint64_t count = 0;
};

// Sorts the first copy by the lowest `bits` bits of its keys; elements of one key keep their order. `scratch` is resized, its contents are lost.
// Out: the copy that holds the sorted elements, 0 or 1.
absl::StatusOr<int> SortByKey(const KeyValueArrays& arrays, int bits, DeviceArray<uint8_t>& scratch,
                              cudaStream_t stream);

}  // namespace voxelpipe::cuda
