// Equal positions as one vertex.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "base/vec.h"

namespace voxelpipe {

struct WeldedVertices {
  std::vector<uint32_t> id;  // of each position, below `count`; equal positions have the same one
  uint64_t count = 0;        // distinct positions
};

// Memory that Weld takes: 8 bytes a position, half of which is its result.
inline constexpr uint64_t kWeldBytes = 2 * sizeof(uint32_t);

// In: fewer than 2^32 positions. Out: ids in ascending order of (x, y, z), so that they do not depend on threads;
// -0 equals +0, and NaN equals NaN. O(n log n) time. Errors: the job's. May throw bad_alloc.
absl::StatusOr<WeldedVertices> Weld(const JobContext& job, const std::vector<Vec3d>& positions);

}  // namespace voxelpipe
