// Plain bits by rows alone (row_kernel.cuh). Included by .cu files only.
#pragma once

#include "cuda/device/kernel_list.h"
#include "cuda/run/run_state.h"
#include "cuda/traversal/raster_args.cuh"

namespace voxelpipe::cuda {

// Whether so many triangles would go by rows that all do, at once: a quarter of a sample, in the grid more than two
// voxels along some axis, and not too many. Looked for once a run.
bool ManyGoByRows(RunState& state);

// Adds the kernel that draws all triangles but those that come to wait in the queues. `together`: what a warp sets is
// brought together first; not with packed corners, whose neighbours lie apart or in each other's way. Behind the kernel
// that clears the grid, beside which it may begin.
void AddRows(const RunState& state, const BitArgs& args, bool together, LaunchList& list);

}  // namespace voxelpipe::cuda
