// Sums over device arrays. CUB compiles slowly, so its instances stand in one place.
#pragma once

#include "cuda/run_state.h"

namespace voxelpipe::cuda {

// out[i] = in[0] + ... + in[i - 1] for i < count, in 64 bits. Uses state.scratch.
absl::Status ExclusiveScan(RunState& state, const uint32_t* in, uint64_t* out, uint64_t count);

// The element of a device array. Synchronizes with the stream.
absl::StatusOr<uint64_t> ReadElement(RunState& state, const uint64_t* at);

}  // namespace voxelpipe::cuda
