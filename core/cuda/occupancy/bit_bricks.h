// Plain bits by way of bricks (bit_bricks.cuh).
#pragma once

namespace voxelpipe::cuda {

struct BitArgs;
class LaunchList;
struct RunState;

// In a grid many times larger than the cache: whether bits are set in bricks first, and the room for that: as many
// places as there are bricks, of which only those that are given are touched. Where triangles are smaller CellKernel
// issues instructions nearly all the time, and looking bricks up takes longer than memory does.
bool MakeBitPool(RunState& state, BitArgs& args);
// Adds the kernel that clears the bricks' places, and the queues of what waits. CellKernel may begin early behind it.
void AddClearPool(const RunState& state, const BitArgs& args, LaunchList& list);
// Adds the one that writes all words of the grid, when CellKernel has drawn in bricks.
void AddStorePool(const RunState& state, const BitArgs& args, LaunchList& list);

}  // namespace voxelpipe::cuda
