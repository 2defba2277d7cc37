// Min and max blends of float4 values in a dense target during rasterization (float4_pass.cuh). Included by .cu files
// only.
#pragma once

#include "cuda/run/run_state.h"
#include "cuda/scatter/atomic_row_sink.cuh"

namespace voxelpipe::cuda {

// For Path::kFloat4: true if the pass computes the target's values itself, so that no kernel has to precompute them.
bool ShadesByFours(RunState& state, const CudaTarget& target);

// Blends all triangles of the slab: small ones during rasterization, deferred ones afterwards. Counts fragments and
// sets the coverage.
absl::Status BlendByFours(RunState& state, const CudaTarget& target, const BlendWriterArgs& args);

}  // namespace voxelpipe::cuda
