// Occupancy bits by way of bricks (bit_bricks.cuh). Included by .cu files only.
#pragma once

namespace voxelpipe::cuda {

struct BitArgs;
class LaunchList;
struct RunState;

// Allocates the pool of OccupancyPath::kBricks, with a slot for every brick, of which only allocated ones are touched.
// False if it finds no memory. Smaller triangles do not take it: CellKernel is then limited by instruction issue, and
// brick lookups cost more than memory accesses.
bool MakeBitPool(RunState& state, BitArgs& args);
// Adds the kernel that clears the slot table and the queues. CellKernel may follow by programmatic dependent launch.
void AddClearPool(const RunState& state, const BitArgs& args, LaunchList& list);
// Adds the kernel that writes all words of the grid from the bricks, after CellKernel.
void AddStorePool(const RunState& state, const BitArgs& args, LaunchList& list);

}  // namespace voxelpipe::cuda
