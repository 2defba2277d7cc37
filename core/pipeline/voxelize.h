// The main job: TriangleMesh + request -> voxels. Read voxelize.cpp first.
#pragma once

#include <functional>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "job/request.h"
#include "job/result.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/plan/plan.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe {

// In: a mesh in world space (textures prepared with PrepareTextures when RequestReadsTextures(request)), a request.
// Out: the result in memory (result.h). Deterministic: the same bytes for any thread count, instruction set, slab depth and
// backend.
// `on_plan`, if set, is called once, before rasterization, on the calling thread.
// Where `auto` takes a GPU that fails or has no room, the CPU does the job: stats.backend and stats.device_failure tell. `on_plan` then has
// heard of the GPU's plan if it came so far, and progress is told from the start again.
// Errors: INVALID_ARGUMENT naming the field, or primitive and vertex where a vertex is not finite or beyond 2^40 voxels
// of the grid; RESOURCE_EXHAUSTED (see PlanVoxelization, or out of memory); CANCELLED; DEADLINE_EXCEEDED;
// FAILED_PRECONDITION where a backend or an instruction set was asked for that this machine does not have.
absl::StatusOr<VoxelizeResult> Voxelize(const TriangleMesh& mesh, const VoxelizeRequest& request, const JobContext& job,
                                        const PlanLimits& limits = {},
                                        const std::function<void(const Plan&)>& on_plan = {});

// The same bytes, handed to `sink` in stream order from the calling thread's arena, and the run's statistics. Dense results are
// made slab after slab, so that memory is bounded by limits.slab_bytes and not by the grid; where several targets, or
// several planes of a planar one, follow each other in stream order, the slabs are made anew for each. Sparse and bucketed
// results are gathered first; what stands in memory as a whole is offered to the sink with Keep. The time that the sink takes
// is not part of the measured time. Errors also: the sink's.
absl::StatusOr<VoxelizeStats> VoxelizeTo(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                         const JobContext& job, const PlanLimits& limits, ResultSink& sink,
                                         const std::function<void(const Plan&)>& on_plan = {});

// Called once, before rasterization; what it returns other than OK ends the run.
using PlanHook = std::function<absl::Status(const Plan&)>;

// Both on a device of the caller's choice (pipeline/stages/backend.h); request.backend is not looked at.
absl::StatusOr<VoxelizeResult> VoxelizeOn(const Backend& backend, const TriangleMesh& mesh,
                                          const VoxelizeRequest& request, const JobContext& job,
                                          const PlanLimits& limits = {}, const PlanHook& on_plan = {});
absl::StatusOr<VoxelizeStats> VoxelizeOnTo(const Backend& backend, const TriangleMesh& mesh,
                                           const VoxelizeRequest& request, const JobContext& job,
                                           const PlanLimits& limits, ResultSink& sink, const PlanHook& on_plan = {});

// VoxelizeOn for a caller that is inside backend.Run or RunEach already.
absl::StatusOr<VoxelizeResult> VoxelizeInside(const Backend& backend, const TriangleMesh& mesh,
                                              const VoxelizeRequest& request, const JobContext& job,
                                              const PlanLimits& limits = {}, const PlanHook& on_plan = {});

}  // namespace voxelpipe
