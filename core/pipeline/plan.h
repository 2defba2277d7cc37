// What a request will cost, known before the work.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "grid/grid_spec.h"
#include "pipeline/request.h"

namespace voxelpipe {

// Slabs begin at multiples of this many layers: tiles and bricks are eight voxels deep, and eight layers of packed bits end on
// a byte.
inline constexpr int64_t kSlabGranularity = 8;

struct PlanLimits {
  uint64_t max_result_bytes = 16ull << 30;   // bytes of all arrays together
  uint64_t max_working_bytes = 20ull << 30;  // predicted peak: result, coverage bits, tiles, shaded vertices
  uint64_t slab_bytes = 512ull << 20;        // streamed dense results: what one slab's targets and bits may take
  int64_t slab_depth = 0;                    // layers a slab, rounded up to a multiple of 8; 0 = the plan's choice
};

// How a result leaves.
enum class Delivery : uint8_t {
  kMemory,  // whole, in memory
  kStream,  // dense: slab after slab, each forgotten when it is handed on; other kinds are gathered in memory first
};

// Where a shaded mesh lies and how large it is, in world units.
struct MeshExtent {
  Box3d box;                  // of the vertices that triangles use
  uint64_t shaded_bytes = 0;  // what the vertex shader made of the vertices; 0 where it left them alone, or did not run
  // Summed over the triangles; 0 where not measured (dense results do not need them). How many voxels the mesh touches
  // follows from these (footprint.cpp).
  Vec3d projected_area{};  // onto the planes orthogonal to x, y, z
  Vec3d dominant_area{};   // the same, of each triangle only the largest of the three
  Vec3d width{};           // extents of each triangle's box along x, y, z
  double volume =
      0;  // signed, between the triangles and the centre of `box`: the enclosed one where the mesh is closed
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
};

// Bytes of one dense target over `voxels` voxels.
uint64_t TargetBytes(const TargetSpec& target, uint64_t voxels);

// Checks everything in `request` that does not depend on a mesh: targets, blends, components, shaders and their
// parameters, coverage, fill. INVALID_ARGUMENT naming the field, e.g. "targets[1].blend: ...".
absl::Status ValidateRequest(const VoxelizeRequest& request);

// In: a request, the mesh's size and the extent of the shaded mesh. Out: the plan.
// Errors: those of ValidateRequest and FitGrid; RESOURCE_EXHAUSTED with need, limit and the largest resolution that
// would fit in its message, and as numbers (limit_error.h).
absl::StatusOr<Plan> PlanVoxelization(const VoxelizeRequest& request, uint64_t triangles, uint64_t vertices,
                                      const MeshExtent& extent, const PlanLimits& limits = {},
                                      Delivery delivery = Delivery::kMemory);

}  // namespace voxelpipe
