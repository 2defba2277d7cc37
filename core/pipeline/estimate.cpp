#include "pipeline/estimate.h"

#include <memory>
#include <new>
#include <utility>

#include "pipeline/run_plan.h"
#include "pipeline/stages/backend.h"
#include "pipeline/stages/bind.h"
#include "pipeline/stages/stages.h"
#include "pipeline/warnings.h"

namespace voxelpipe {
namespace {

absl::StatusOr<Plan> PlanInside(const Backend& backend, const TriangleMesh& mesh, const VoxelizeRequest& request,
                                const JobContext& job, const PlanLimits& limits, Delivery delivery) {
  const absl::StatusOr<BoundRequest> bound = BindRequest(job, mesh, request);
  if (!bound.ok()) return bound.status();
  if (absl::Status s = CheckStrict(request, WarningsOf(mesh, *bound)); !s.ok()) return s;
  absl::StatusOr<std::unique_ptr<Stages>> stages = backend.Start(mesh, *bound, job);
  if (!stages.ok()) return stages.status();
  absl::StatusOr<MeshExtent> extent = (*stages)->VertexShade();
  if (!extent.ok()) return extent.status();
  const MeshSize size{mesh.triangles.size(), mesh.positions.size(), *std::move(extent)};
  absl::StatusOr<PlannedRun> run = RunPlanner(backend, **stages, bound->request, size, limits, delivery).Make();
  if (!run.ok()) return run.status();
  AddParts(bound->part_table, run->plan);
  return std::move(run->plan);
}

}  // namespace

absl::StatusOr<Plan> EstimateVoxelization(const Backend& backend, const TriangleMesh& mesh,
                                          const VoxelizeRequest& request, const JobContext& job,
                                          const PlanLimits& limits, Delivery delivery) {
  absl::StatusOr<Plan> plan = absl::UnknownError("the run did not start");
  backend.Run(request.threads, [&] {
    try {
      plan = PlanInside(backend, mesh, request, job, limits, delivery);
    } catch (const std::bad_alloc&) {
      plan = absl::ResourceExhaustedError("out of memory while planning");
    }
  });
  return plan;
}

absl::StatusOr<Plan> EstimateVoxelization(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                          const JobContext& job, const PlanLimits& limits, Delivery delivery) {
  const absl::StatusOr<const Backend*> backend = SelectBackend(request.backend);
  if (!backend.ok()) return backend.status();
  return EstimateVoxelization(**backend, mesh, request, job, limits, delivery);
}

}  // namespace voxelpipe
