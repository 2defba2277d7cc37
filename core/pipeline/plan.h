// What a request will cost, known before the work.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "grid/grid_spec.h"
#include "pipeline/request.h"

namespace voxelpipe {

struct PlanLimits {
  uint64_t max_result_bytes = 16ull << 30;   // bytes of all targets together
  uint64_t max_working_bytes = 20ull << 30;  // predicted peak: result, coverage bits, tiles, shaded vertices
};

enum class TimeClass : uint8_t { kInstant, kShort, kLong };  // < 0.1 s, < 2 s, longer, on two cores: a rough guide

struct Plan {
  GridSpec grid;
  uint64_t result_bytes = 0;  // of all targets together
  uint64_t peak_bytes = 0;    // predicted working set of the pipeline, the result included, the mesh excluded
  std::string backend;        // "cpu" or "cuda"
  TimeClass time_class = TimeClass::kInstant;
};

// Bytes of one target over `voxels` voxels.
uint64_t TargetBytes(const TargetSpec& target, uint64_t voxels);

// Checks everything in `request` that does not depend on a mesh: targets, blends, components, shaders and their
// parameters, coverage, fill. INVALID_ARGUMENT naming the field, e.g. "targets[1].blend: ...".
absl::Status ValidateRequest(const VoxelizeRequest& request);

// In: a request, the mesh's size and the box of its shaded vertices. Out: the plan.
// Errors: those of ValidateRequest and FitGrid; RESOURCE_EXHAUSTED with need, limit and the largest resolution that
// would fit in its message.
absl::StatusOr<Plan> PlanVoxelization(const VoxelizeRequest& request, uint64_t triangles, uint64_t vertices,
                                      const Box3d& shaded_box, const PlanLimits& limits = {});

}  // namespace voxelpipe
