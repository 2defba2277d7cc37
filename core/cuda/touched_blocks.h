// Dense targets whose covered voxels are not set in a bit grid, but found when they are counted: in the blocks where triangles were blended
// (touched_blocks.cuh). Included by .cu files only.
#pragma once

#include "cuda/run_state.h"
#include "cuda/touched_blocks.cuh"

namespace voxelpipe::cuda {

// Whether the slab's only target tells by its values which voxels are covered, but for those of the first triangle: the largest triangle id, without a
// fill. Once the slab and its targets are known.
bool KeepsTouched(RunState& state);
// The slab's marks, none set.
absl::Status ClearTouched(RunState& state);
// They as kernels get them; none unless state.keeps_touched.
TouchedBlocks TouchedOf(RunState& state);
// Adds the voxels of the drawn slab that are covered to state.counters[kVoxels].
absl::Status CountTouched(RunState& state);

}  // namespace voxelpipe::cuda
