// Largest and least values of four components of a dense target, blended as triangles are found (four_walk.cuh). Included by .cu files only.
#pragma once

#include "cuda/blend_writer.cuh"
#include "cuda/run_state.h"

namespace voxelpipe::cuda {

// Whether a target's triangles are blended so, once the slab is known: those of fine meshes that are not scattered, where there is no other target of values.
bool GoesByFours(RunState& state, const CudaTarget& target);
// Whether its values are made then, too, and no kernel has to make them before.
bool ShadesByFours(RunState& state, const CudaTarget& target);

// Blends every triangle of the slab, small ones at once, what is left behind it; counts fragments and sets the coverage.
absl::Status BlendByFours(RunState& state, const CudaTarget& target, const BlendWriterArgs& args);

}  // namespace voxelpipe::cuda
