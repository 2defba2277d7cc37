// Largest and least values of four components of a dense target, blended as triangles are found (float4_pass.cuh).
// Included by .cu files only.
#pragma once

#include "cuda/run/run_state.h"
#include "cuda/scatter/atomic_row_sink.cuh"

namespace voxelpipe::cuda {

// Under Path::kFloat4: true if the target's values are made meanwhile, and no kernel has to make them before.
bool ShadesByFours(RunState& state, const CudaTarget& target);

// Blends every triangle of the slab, small ones at once, what is left behind it; counts fragments and sets the
// coverage.
absl::Status BlendByFours(RunState& state, const CudaTarget& target, const BlendWriterArgs& args);

}  // namespace voxelpipe::cuda
