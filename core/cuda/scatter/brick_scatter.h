// Blending in bricks that are allocated during rasterization (brick_scatter.cuh): of a single target, without a fill, a
// sparse float with min or max, or owners, sparse or dense. Included by .cu files only.
#pragma once

#include "cuda/coverage/atomic_blend.cuh"
#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

// Rasterizes all triangles. If the pool is too small, changes the plan for all slabs of the run; nothing is done then
// except counting fragments. Synchronizes.
absl::Status BlendIntoPool(RunState& state, const InPlaceArgs& blend, bool by_id);
// Converts the pool to state.result.
absl::Status EmitPool(RunState& state);

}  // namespace voxelpipe::cuda
