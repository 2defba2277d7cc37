// Detects spatially incoherent (unordered) meshes with many triangles and prepares copies of them that are faster to
// rasterize: their memory accesses are scattered, and their few largest triangles overlap all others.
#pragma once

#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

// True if neighbours in triangle order are far apart: in a sample, more than half of the pairs by more than a sixteenth
// of the grid. Computed once per run.
bool IsScattered(RunState& state);

// Makes state.scattered_mesh for an unordered mesh, unless it exists; not under center coverage, which uses other
// paths. It is cached with the mesh if that is cached and space permits. If memory is short there is none, and kernels
// read the mesh itself. Large triangles are those that reach over an eighth of the mesh's box along some axis. If they
// exceed the capacity only the first are listed, and in a grid much smaller than the mesh long triangles may not be
// listed. The result does not depend on it.
void PrepareScattered(RunState& state);

}  // namespace voxelpipe::cuda
