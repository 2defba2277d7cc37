// Ranks of covered voxels, and accumulators by them. Included by .cu files only.
#pragma once

#include "cuda/coverage/accumulators.cuh"
#include "cuda/device/launch.cuh"
#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

// Numbers the voxels that some triangle touches; state.counters[kRanks] is how many there are.
absl::Status RankCovered(RunState& state);
// These numbers, and a target's accumulators.
Ranks RanksOf(RunState& state);
Accumulators AccumulatorsOf(RunState& state, int index);
// Accumulators of a target for `voxels` voxels, set to where blending starts.
absl::Status BeginAccumulators(RunState& state, int index, uint64_t voxels);

}  // namespace voxelpipe::cuda
