// Flood fill: the inside of a mesh.
#pragma once

#include "absl/status/status.h"
#include "cpu/run_state.h"

namespace voxelpipe::cpu {

// The flood itself, of the whole grid, because it crosses slabs; nothing where it was done. Takes two grids of bits and
// keeps one. RESOURCE_EXHAUSTED, CANCELLED, DEADLINE_EXCEEDED.
absl::Status FindOutside(RunState& state);

// Sets `out`, bits of the slab, to the voxels that a 6-connected flood from an empty layer around the grid does not
// reach through voxels outside the conservative shell, which include the shell's own voxels. With `add` they are or-ed
// to its bits. Errors: those of FindOutside.
absl::Status FloodInside(RunState& state, BitGrid& out, bool add);

}  // namespace voxelpipe::cpu
