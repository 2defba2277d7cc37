// Computes ranks of covered voxels and allocates accumulators. Included by .cu files only.
#pragma once

#include "cuda/coverage/accumulators.cuh"
#include "cuda/device/launch.cuh"
#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

// Ranks the voxels that triangles touch; state.counters[kRanks] receives their number.
absl::Status RankCovered(RunState& state);
// The ranks, and a target's accumulators.
Ranks RanksOf(RunState& state);
Accumulators AccumulatorsOf(RunState& state, int index);
// Allocates a target's accumulators for `voxels` voxels and sets their initial values.
absl::Status BeginAccumulators(RunState& state, int index, uint64_t voxels);

}  // namespace voxelpipe::cuda
