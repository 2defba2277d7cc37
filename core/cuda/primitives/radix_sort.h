// Radix sorts: of 32-bit key-value pairs, stable, and of 64-bit keys alone. Wraps CUB, whose instances compile slowly,
// in one translation unit.
#pragma once

#include <array>
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

// Sorts the first copy of `count` keys by their bits [begin_bit, end_bit). Resizes `scratch` and overwrites it. Returns
// the copy that holds the sorted keys, 0 or 1.
absl::StatusOr<int> SortKeys(const std::array<uint64_t*, 2>& keys, uint64_t count, int begin_bit, int end_bit,
                             DeviceArray<uint8_t>& scratch, cudaStream_t stream);

// Stably sorts the first copy by the lowest `bits` bits of its keys. Resizes `scratch` and overwrites it. Returns the
// copy that holds the sorted elements, 0 or 1.
absl::StatusOr<int> SortByKey(const KeyValueArrays& arrays, int bits, DeviceArray<uint8_t>& scratch,
                              cudaStream_t stream);

}  // namespace voxelpipe::cuda
