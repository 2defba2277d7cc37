// Prefix sums of device arrays. Wraps CUB, whose instances compile slowly, in one translation unit.
#pragma once

#include <cstdint>

#include "absl/status/statusor.h"
#include "cuda/device/buffer.h"

namespace voxelpipe::cuda {

// out[i] = in[0] + ... + in[i - 1] for i < count, in 64 bits. `scratch` is temporary storage for CUB.
absl::Status ExclusiveScan(const uint32_t* in, uint64_t* out, uint64_t count, DeviceArray<uint8_t>& scratch,
                           cudaStream_t stream);

// Reads one element of a device array. Synchronizes with the stream.
absl::StatusOr<uint64_t> ReadElement(const uint64_t* at, cudaStream_t stream);

}  // namespace voxelpipe::cuda
