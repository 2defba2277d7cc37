// Meshes of many triangles in no order, which walks take in other ways: their arrays are read once each, from all over
// memory, and their few largest triangles reach where all others do.
#pragma once

#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

// Whether neighbours in the order of triangles lie far apart, by a sample: every second pair more than a sixteenth of
// the grid. Looked for once a run.
bool IsScattered(RunState& state);

// Makes state.scattered_mesh of a scattered mesh, if it is not made; not under center coverage, which goes by other
// ways. It is kept with the mesh where that is and there is room. Without memory for it there is none, and walks do
// without. Large are triangles that reach over an eighth of the mesh's box along some axis: of more than there is place
// for, those that come first are listed; and in a grid much smaller than the mesh triangles may be long without being
// among them. Either way the bytes are the same.
void PrepareScattered(RunState& state);

}  // namespace voxelpipe::cuda
