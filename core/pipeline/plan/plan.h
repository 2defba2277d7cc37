// What a request will cost, known before the work.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "grid/grid_spec.h"
#include "job/part_table.h"
#include "job/request.h"
#include "pipeline/plan/surface.h"

namespace voxelpipe {

// Slabs begin at multiples of this many layers: tiles and bricks are eight voxels deep, and eight layers of packed bits
// end on a byte.
inline constexpr int64_t kSlabGranularity = 8;

struct PlanLimits {
  uint64_t max_result_bytes = 16ull << 30;   // bytes of all arrays together
  uint64_t max_working_bytes = 20ull << 30;  // predicted peak: result, coverage bits, tiles, shaded vertices
  // What a slab of a streamed dense result may take: targets and bits. Lists too, unless a backend has more for them.
  uint64_t slab_bytes = 512ull << 20;
  int64_t slab_depth = 0;                  // layers a slab, rounded up to a multiple of 8; 0 = the plan's choice
  std::string_view working_limit_is = {};  // in errors, after max_working_bytes: where this figure comes from
};

// The limits of a job in this process whose mesh is loaded and charged to MemoryOf(job): those above, and of the
// working memory what the budget has left.
PlanLimits LimitsInProcess(const JobContext& job);

// How a result leaves.
enum class Delivery : uint8_t {
  kMemory,  // whole, in memory
  kStream,  // dense: slab after slab, each forgotten when it is handed on; other kinds are gathered in memory first
};

enum class TimeClass : uint8_t { kInstant, kShort, kLong };  // < 0.1 s, < 2 s, longer, on two cores: a rough guide

struct Plan {
  GridSpec grid;
  uint64_t result_bytes = 0;  // of all arrays together; an estimate for sparse and bucketed results
  uint64_t peak_bytes =
      0;                // predicted working set of the pipeline, what is held of the result included, the mesh excluded
  std::string backend;  // "cpu" or "cuda"
  TimeClass time_class = TimeClass::kInstant;
  int64_t slab_depth =
      1;  // layers of z worked on at a time; at least dims[2] where one slab does. A run may come to take fewer
  uint64_t list_bytes = 0;  // the part of peak_bytes whose lists a run counts as it makes them (list_memory.h)
};

// Adds the table of a result's parts, which the run holds and the result gets a copy of.
inline void AddParts(const PartTable& parts, Plan& plan) {
  plan.result_bytes += parts.bytes();
  plan.peak_bytes += 2 * parts.bytes();
}

// Bytes of one dense target over `voxels` voxels.
uint64_t TargetBytes(const TargetSpec& target, uint64_t voxels);

// Checks everything in `request` that does not depend on a mesh: the form of the grid, targets, blends, components,
// shaders and their parameters, coverage, fill. Errors: INVALID_ARGUMENT naming the field, e.g. "targets[1].blend:
// ..."; those of CheckGridRequest.
absl::Status ValidateRequest(const VoxelizeRequest& request);

}  // namespace voxelpipe
