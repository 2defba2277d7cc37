// Flood fill: the inside of a mesh.
#pragma once

#include "absl/status/status.h"
#include "cpu/run_state.h"

namespace voxelpipe::cpu {

// The voxels that a 6-connected flood from an empty layer around the grid does not reach through voxels outside the
// conservative shell, which include the shell's own voxels. With `add` they are or-ed to the bits of `out`, the slab's
// coverage; else `out` is made of them. The flood is of the whole grid, because it crosses slabs: the first slab's call
// keeps what later ones need. After FineRaster. RESOURCE_EXHAUSTED, CANCELLED, DEADLINE_EXCEEDED.
absl::Status FloodInside(RunState& state, BitGrid& out, bool add);

}  // namespace voxelpipe::cpu
