// The main job: TriangleMesh + request -> render targets. Read voxelize.cpp first.
#pragma once

#include <functional>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "grid/grid_spec.h"
#include "grid/host_buffer.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/plan.h"
#include "pipeline/request.h"
#include "pipeline/stats.h"

namespace voxelpipe {

struct VoxelizeResult {
  GridSpec grid;
  Layout layout = Layout::kInterleaved;
  std::vector<TargetSpec> specs;    // as requested
  std::vector<HostBuffer> targets;  // one per spec, in format and layout; TargetBytes() bytes each
  VoxelizeStats stats;
};

// Result bytes "in stream order" are targets[0], targets[1], ... one after the other.

// In: a mesh in world space (textures prepared with PrepareTextures when RequestReadsTextures(request)), a request.
// Out: dense targets over the fitted grid. Deterministic: the same bytes for any thread count and backend.
// `on_plan`, if set, is called once, before rasterization, on the calling thread.
// Errors: INVALID_ARGUMENT naming the field, or primitive and vertex where a vertex is not finite or beyond 2^40 voxels of the
// grid; RESOURCE_EXHAUSTED (see PlanVoxelization, or out of memory); CANCELLED; DEADLINE_EXCEEDED; FAILED_PRECONDITION where a
// backend was asked for that this machine does not have.
absl::StatusOr<VoxelizeResult> Voxelize(const TriangleMesh& mesh, const VoxelizeRequest& request, const JobContext& job,
                                        const PlanLimits& limits = {},
                                        const std::function<void(const Plan&)>& on_plan = {});

}  // namespace voxelpipe
