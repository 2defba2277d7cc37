// Fills of parts that bound solids of their own: which part owns the inside of a voxel.
#pragma once

#include "cpu/run_state.h"

namespace voxelpipe::cpu {

// Writes the voxels of the slab whose centre lies in some part to `inside`, or adds them to its bits. Counts the odd
// columns of parts, and the voxels whose centre lies in each part and in none of a higher rank. With needs_ranks,
// state.inside_ranks then has for each voxel of the slab the rank plus 1 of the highest part around its centre. Errors:
// those of the lists, the job's.
absl::Status FillParts(RunState& state, BitGrid& inside, bool add);

}  // namespace voxelpipe::cpu
