// What a run would cost, of a mesh that is there.
#pragma once

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "job/request.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/plan/plan.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe {

// In: what Voxelize (Delivery::kMemory) or VoxelizeTo (kStream) takes, and the backend that would run it; the request's
// own choice is not looked at. Out: the plan that they would report: vertices are shaded and triangles measured,
// nothing is rasterized. Errors: all that they return before they rasterize.
absl::StatusOr<Plan> EstimateVoxelization(const Backend& backend, const TriangleMesh& mesh,
                                          const VoxelizeRequest& request, const JobContext& job,
                                          const PlanLimits& limits, Delivery delivery);
// The same on the backend of the request's choice.
absl::StatusOr<Plan> EstimateVoxelization(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                          const JobContext& job, const PlanLimits& limits, Delivery delivery);

}  // namespace voxelpipe
