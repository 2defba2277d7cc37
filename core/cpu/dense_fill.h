// Writing one value to many elements of a dense target.
#pragma once

#include <cstdint>
#include <span>

#include "absl/status/status.h"
#include "cpu/run_state.h"

namespace voxelpipe::cpu {

// Sets the whole buffer to `stored`, an element of `element_bytes` (1, 2 or 4), with stores that do not read the old contents into the
// caches. Parallel; CANCELLED, DEADLINE_EXCEEDED.
absl::Status ClearElements(HostBuffer& buffer, uint32_t stored, int element_bytes, const JobContext& job);

// Writes the fill value of a target that is not bit to the voxels of slab row `row` that are set in `inside` and have no
// fragment of the target's.
void FillRow(RunState& state, CpuTarget& target, int64_t row, std::span<const uint32_t> inside);

}  // namespace voxelpipe::cpu
