// Writing one value to many elements of a dense target.
#pragma once

#include <cstdint>
#include <span>

#include "cpu/run_state.h"

namespace voxelpipe::cpu {

// Sets voxels x_begin <= x < x_end of the rows of `rows` (grid coordinates, in the slab) to the clear value of a target
// that is not bit. The caller ends with StreamFence.
void ClearRows(const RunState& state, CpuTarget& target, const VoxelRange& rows, int64_t x_begin, int64_t x_end);

// Writes the fill value of a target that is not bit to the voxels of slab row `row` that are set in `inside` and have
// no fragment of the target.
void FillRow(RunState& state, CpuTarget& target, int64_t row, std::span<const uint32_t> inside);

}  // namespace voxelpipe::cpu
