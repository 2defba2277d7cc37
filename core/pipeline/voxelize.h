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

// Called once, before rasterization, on the calling thread; a status other than OK ends the run with it.
using PlanHook = std::function<absl::Status(const Plan&)>;

// A job that neither ends nor reports progress.
inline const JobContext& PlainJob() {
  static const JobContext job;
  return job;
}

// How a run is done, as opposed to what it makes (VoxelizeRequest). All that is pointed to outlives the call.
struct RunOptions {
  const JobContext& job = PlainJob();
  PlanLimits limits = {};
  PlanHook on_plan = {};  // may be empty
  // The device (pipeline/stages/backend.h); request.backend is ignored then. Null: the device that request.backend
  // chooses. With `auto` and a GPU that fails or has no room, the CPU runs the job: stats.backend and
  // stats.device_failure report it, on_plan may have been called with the GPU's plan, and progress starts again.
  const Backend* backend = nullptr;
  bool inside = false;  // the caller is in backend->Run or RunEach already; ignored if `backend` is null
  // Voxelize leaves a dense result of one slab that a GPU makes in that GPU's memory (ResultArrays::device_targets, the
  // same bytes), with all work on it done. Any other result is in the host's memory.
  bool on_device = false;
};

// In: a mesh in world space with the guarantees of triangle_mesh.h, which loaders give and CheckMesh
// (mesh/health/check_mesh.h) looks for in a mesh of one's own arrays; a request. Where its shaders sample textures, the
// mesh has them if it was loaded with LoadRequest::textures = TexturesRead(request) (load/load_mesh.h); of a mesh from
// elsewhere, PrepareTexturesFor (load/decode/image.h) decodes them. Without that the factors of the materials are used.
// Out: the result in memory (result.h). Deterministic: the same bytes for any thread count, instruction set, slab depth
// and backend.
// Errors: INVALID_ARGUMENT naming the field, or primitive and vertex where a vertex is not finite or beyond 2^40 voxels
// of the grid; RESOURCE_EXHAUSTED (see PlanVoxelization, or out of memory); CANCELLED; DEADLINE_EXCEEDED;
// FAILED_PRECONDITION where a backend or an instruction set was asked for that this machine does not have; that of
// options.on_plan.
absl::StatusOr<VoxelizeResult> Voxelize(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                        const RunOptions& options);

// The same bytes, handed to `sink` in stream order, and the run's statistics. Dense results are made slab after slab,
// so that memory is bounded by limits.slab_bytes and not by the grid; where several targets, or several planes of a
// planar one, follow each other in stream order, the slabs are made anew for each (stats.passes). Sparse and bucketed
// results are gathered first; a result that is in memory as a whole is offered to the sink with Keep. The sink is
// called from the backend's threads, one call at a time, and its time is not part of the measured time. Errors also:
// the sink's.
absl::StatusOr<VoxelizeStats> VoxelizeTo(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                         const RunOptions& options, ResultSink& sink);

}  // namespace voxelpipe
