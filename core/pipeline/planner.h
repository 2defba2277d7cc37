// Plans of requests.
#pragma once

#include <functional>

#include "absl/status/statusor.h"
#include "job/request.h"
#include "pipeline/plan/plan.h"
#include "pipeline/plan/surface.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe {

// What the mesh touches of a grid: Stages::Measure.
using MeasureGrid = std::function<absl::StatusOr<Surface>(const GridSpec&, bool closely)>;

// What plans are made of. All that is given outlives them.
struct PlanInput {
  const Backend& backend;  // that will run it
  const VoxelizeRequest& request;
  const MeshSize& mesh;
  MeasureGrid measure;
  const PlanLimits& limits;
  Delivery delivery;
};

struct PlannedRun {
  Plan plan;
  Surface surface;
};

// PlanVoxelization of a request that BindRequest has checked.
absl::StatusOr<PlannedRun> PlanOn(const PlanInput& input);

// RESOURCE_EXHAUSTED for a run that needs, or comes to need, at least `need_bytes` of results or memory. In the message
// and as numbers: the largest grid of the request's kind that would fit. `scale`: what is really needed of what is
// predicted, at least 1; above 1 a run came to need more than predicted. `measured`: the surface of `grid`; null if it
// is unknown. The error of `measure` instead where it gave one: the job may end meanwhile.
absl::Status GridTooLarge(const PlanInput& input, const GridSpec& grid, const Surface* measured, bool of_results,
                          uint64_t need_bytes, double scale);

// In: a request, the backend that would run it, the mesh's size and the extent of the shaded mesh, no look at its
// triangles. Out: the plan of that backend. Errors: those of ValidateRequest and FitGrid; RESOURCE_EXHAUSTED with need,
// limit and the largest grid of the same mesh that would fit, in its message in the terms in which the grid was asked
// for (resolution, voxel size or dims), and as numbers (limit_error.h).
absl::StatusOr<Plan> PlanVoxelization(const Backend& backend, const VoxelizeRequest& request, uint64_t triangles,
                                      uint64_t vertices, const MeshExtent& extent, const PlanLimits& limits = {},
                                      Delivery delivery = Delivery::kMemory);
// The same on the backend of the request's choice.
absl::StatusOr<Plan> PlanVoxelization(const VoxelizeRequest& request, uint64_t triangles, uint64_t vertices,
                                      const MeshExtent& extent, const PlanLimits& limits = {},
                                      Delivery delivery = Delivery::kMemory);

}  // namespace voxelpipe
