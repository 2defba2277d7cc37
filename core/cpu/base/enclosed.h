// The flood itself: from a layer around a grid through the voxels outside a shell.
#pragma once

#include <array>
#include <cstdint>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "grid/bit_grid.h"

namespace voxelpipe::cpu {

// In: a grid of `dims` voxels, the bits of which are the shell. Out: the voxels that a 6-connected flood from an empty
// layer around the grid does not reach through voxels outside the shell; the shell is among them. Takes a time in
// proportion to the voxels, whatever the ways through the shell. `block_layers`: of the blocks that threads work on; 0:
// as many as fit a cache. RESOURCE_EXHAUSTED, CANCELLED, DEADLINE_EXCEEDED.
absl::StatusOr<BitGrid> Enclosed(const BitGrid& shell, const std::array<int64_t, 3>& dims, const JobContext& job,
                                 int64_t block_layers = 0);

// What Enclosed takes besides the grid that it returns.
uint64_t EnclosedWorkBytes(const std::array<int64_t, 3>& dims);

}  // namespace voxelpipe::cpu
