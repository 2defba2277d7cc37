// A stable radix sort of keys with 32-bit values: CUB's, whose instances compile slowly and stand in one place.
#pragma once

#include <cstdint>

#include "absl/status/statusor.h"
#include "cuda/device/buffer.h"

namespace voxelpipe::cuda {

// Two copies of an array of keys and of their values: one holds them, the other is as large.
struct KeyValueArrays {
  void* keys[2] = {};  // of 32 bits, or of 64 (KeySort)
  uint32_t* values[2] = {};
  uint64_t count = 0;
};

struct KeySort {
  bool wide_keys = false;  // 64 bits, not 32
  int bits = 0;            // the lowest that keys have
};

// Sorts the first copy by its keys; elements of one key keep their order. `scratch` is resized, its contents are lost.
// Out: the copy that holds the sorted elements, 0 or 1.
absl::StatusOr<int> SortByKey(const KeyValueArrays& arrays, const KeySort& sort, DeviceArray<uint8_t>& scratch,
                              cudaStream_t stream);

}  // namespace voxelpipe::cuda
