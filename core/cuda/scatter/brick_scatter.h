// Sparse results whose bricks are given out while triangles are drawn (brick_scatter.cuh): of one target of floats, whose
// largest or least value is sought, without a fill. Included by .cu files only.
#pragma once

#include "cuda/coverage/atomic_blend.cuh"
#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

// Draws all triangles. Where there is no room for all bricks the plan becomes another, for all slabs of the run, and
// nothing was done but fragments counted. Synchronizes.
absl::Status BlendIntoPool(RunState& state, const InPlaceArgs& blend, bool by_id);
// What was drawn becomes state.result.
absl::Status EmitPool(RunState& state);

}  // namespace voxelpipe::cuda
