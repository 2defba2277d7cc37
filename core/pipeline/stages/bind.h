// A request and its shaders, checked and bound to a mesh.
#pragma once

#include "absl/status/statusor.h"
#include "job/request.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/plan/plan.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe {

// Errors: those of ValidateRequest; INVALID_ARGUMENT naming the target whose shader asks for an attribute that the mesh
// does not have.
absl::StatusOr<BoundRequest> BindRequest(const JobContext& job, const TriangleMesh& mesh,
                                         const VoxelizeRequest& request);

}  // namespace voxelpipe
