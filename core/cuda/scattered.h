// Meshes of many triangles in no order, which walks take in other ways: their arrays are read once each, from all over memory, and their few
// largest triangles reach where all others do. Included by .cu files only.
#pragma once

#include "cuda/run_state.h"

namespace voxelpipe::cuda {

// Whether neighbours in the order of triangles lie far apart, by a sample: every second pair more than a sixteenth of the grid. Looked for once a
// run.
bool IsScattered(RunState& state);

// Makes state.scattered_mesh of a scattered mesh, if it is not made. It is kept with the mesh where that is. Without memory for it
// there is none, and walks do without.
void PrepareScattered(RunState& state);

}  // namespace voxelpipe::cuda
