// What a run would cost, of a mesh that is there.
#pragma once

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "job/request.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/plan/plan.h"

namespace voxelpipe {

// In: what VoxelizeOn takes. Out: the plan that it would tell on the backend of the request's choice: vertices are
// shaded and triangles looked at, nothing is rasterized. Errors: those of VoxelizeOn until then.
absl::StatusOr<Plan> EstimateVoxelization(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                          const JobContext& job, const PlanLimits& limits, Delivery delivery);

}  // namespace voxelpipe
