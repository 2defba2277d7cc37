// Who owns voxels where parts are filled. Included by .cu files only.
#pragma once

#include "cuda/run/run_state.h"
#include "cuda/scatter/blend_spans.cuh"

namespace voxelpipe::cuda {

// The target whose accumulators hold the largest number of a triangle in each voxel, discarded fragments included; -1:
// none do, and state.parts.owners has them.
int TargetOfOwners(const RunState& state);

// Clears state.parts.owners for `voxels` ranked voxels. Out: what accumulates numbers of triangles there; spans and
// records are not set.
absl::Status BeginOwners(RunState& state, uint64_t voxels);
AccumulateArgs OwnersOf(RunState& state);

// Of each triangle the key of its id, for targets that keep the smallest id: numbers are in another order.
absl::Status ListOwnerIds(RunState& state, uint32_t* keys);

}  // namespace voxelpipe::cuda
