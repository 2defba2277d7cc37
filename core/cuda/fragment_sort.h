// Sorts the A-buffer's fragments. CUB compiles slowly, so its instances stand in one place.
#pragma once

#include "cuda/run_state.h"

namespace voxelpipe::cuda {

// Sorts state.fragment_keys and fragment_triangles by the lowest `bits` bits of the keys, which are 64 bits wide or 32;
// fragments of one key keep their order. Uses state.scratch; sets state.fragments_in.
absl::Status SortByKey(RunState& state, bool wide_keys, int bits);

}  // namespace voxelpipe::cuda
