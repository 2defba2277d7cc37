// Launches the row kernel for occupancy bits (row_kernel.cuh). Included by .cu files only.
#pragma once

#include "cuda/device/kernel_list.h"
#include "cuda/run/run_state.h"
#include "cuda/traversal/raster_args.cuh"

namespace voxelpipe::cuda {

// True if all triangles should be rasterized by rows at once: more than a quarter of a sample spans more than two
// voxels along some axis, but not too many (kMaxCells). Computed once per run.
bool ManyGoByRows(RunState& state);

// Appends the kernel that draws all triangles except those that it defers to the queues. `together`: bits are combined
// per warp; not with packed corners, whose neighbours are far apart or contend for the same words. It follows the
// kernel that clears the grid and may overlap it.
void AddRows(const RunState& state, const BitArgs& args, bool together, LaunchList& list);

}  // namespace voxelpipe::cuda
