// The sort-middle pipeline, stage by stage. Source: J. Pantaleoni, "VoxelPipe: A Programmable Pipeline for 3D
// Voxelization", HPG 2011, section 3.
#include "pipeline/voxelize.h"

#include <ctime>

#include <chrono>
#include <memory>
#include <new>

#include "absl/strings/str_cat.h"
#include "pipeline/backend.h"
#include "pipeline/stages.h"

namespace voxelpipe {
namespace {

double WallMs() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// CPU time of the whole process: with one job at a time, that job's on all its threads.
double CpuMs() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) * 1e3 + double(t.tv_nsec) * 1e-6;
}

// Runs one stage: asks first whether the job may go on, reports progress, keeps the time.
class StageClock {
 public:
  StageClock(const JobContext& job, VoxelizeStats& stats) : job_(job), stats_(stats) {}

  template <typename Stage>
  auto operator()(const char* name, Stage&& stage) -> decltype(stage()) {
    if (absl::Status s = job_.Check(); !s.ok()) return s;
    job_.Report(name, 0);
    const double begin = WallMs();
    auto result = stage();
    const double ms = WallMs() - begin;
    if (!stats_.stages.empty() && stats_.stages.back().first == name) {
      stats_.stages.back().second += ms;
    } else {
      stats_.stages.emplace_back(name, ms);
    }
    job_.Report(name, 1);
    return result;
  }

 private:
  const JobContext& job_;
  VoxelizeStats& stats_;
};

absl::StatusOr<BoundRequest> Bind(const VoxelizeRequest& request) {
  if (absl::Status s = ValidateRequest(request); !s.ok()) return s;
  BoundRequest bound;
  bound.request = request;
  auto vertex = BindShader(ShaderStage::kVertex, request.vertex_shader);
  if (!vertex.ok()) return vertex.status();
  bound.vertex_shader = *vertex;
  for (const TargetSpec& target : request.targets) {
    auto fragment = BindShader(ShaderStage::kFragment, target.shader);
    if (!fragment.ok()) return fragment.status();
    bound.fragment_shaders.push_back(*fragment);
  }
  return bound;
}

absl::StatusOr<VoxelizeResult> RunStages(const Backend& backend, const TriangleMesh& mesh, const BoundRequest& bound,
                                         const JobContext& job, const PlanLimits& limits,
                                         const std::function<void(const Plan&)>& on_plan) {
  const VoxelizeRequest& request = bound.request;
  VoxelizeResult result;
  result.specs = request.targets;
  result.layout = request.layout;
  result.stats.triangles = mesh.triangles.size();
  result.stats.backend = std::string(backend.name());
  result.stats.simd = std::string(backend.simd());
  StageClock run(job, result.stats);
  const double wall = WallMs(), cpu = CpuMs();

  absl::StatusOr<std::unique_ptr<Stages>> started = backend.Start(mesh, bound, job);
  if (!started.ok()) return started.status();
  Stages& stages = **started;

  absl::StatusOr<Box3d> box = run("vertex_shade", [&] { return stages.VertexShade(); });
  if (!box.ok()) return box.status();
  absl::StatusOr<Plan> plan = PlanVoxelization(request, mesh.triangles.size(), mesh.positions.size(), *box, limits);
  if (!plan.ok()) return plan.status();
  if (on_plan) on_plan(*plan);
  result.grid = plan->grid;

  if (absl::Status s = stages.ClearTargets(result.grid); !s.ok()) return s;
  absl::Status s = run("coarse_raster", [&] { return stages.CoarseRaster(); });
  if (!s.ok()) return s;
  s = run("tile_sort", [&] { return stages.TileSort(); });
  if (!s.ok()) return s;
  s = run("fine_raster", [&] { return stages.FineRaster(); });
  if (!s.ok()) return s;
  if (request.fill != Fill::kNone) {
    s = run("fill", [&] { return stages.SolidFill(); });
    if (!s.ok()) return s;
  }
  // Packing the targets ends whichever stage wrote them last.
  const char* last_stage = request.fill == Fill::kNone ? "fine_raster" : "fill";
  absl::StatusOr<std::vector<HostBuffer>> targets = run(last_stage, [&] { return stages.Finish(); });
  if (!targets.ok()) return targets.status();
  result.targets = *std::move(targets);
  result.stats.voxelize_ms = WallMs() - wall;
  result.stats.voxelize_cpu_ms = CpuMs() - cpu;

  result.stats.occupied = stages.CountOccupied();
  const StageCounts counts = stages.counts();
  result.stats.fragments = counts.fragments;
  if (request.fill == Fill::kParity) result.stats.odd_columns = counts.odd_columns;
  return result;
}

}  // namespace

absl::StatusOr<VoxelizeResult> Voxelize(const TriangleMesh& mesh, const VoxelizeRequest& request, const JobContext& job,
                                        const PlanLimits& limits, const std::function<void(const Plan&)>& on_plan) {
  absl::StatusOr<BoundRequest> bound = Bind(request);
  if (!bound.ok()) return bound.status();
  absl::StatusOr<const Backend*> backend = SelectBackend(request.backend);
  if (!backend.ok()) return backend.status();
  absl::StatusOr<VoxelizeResult> result = absl::UnknownError("the run did not start");
  (*backend)->Run(request.threads, [&] {
    try {
      result = RunStages(**backend, mesh, *bound, job, limits, on_plan);
    } catch (const std::bad_alloc&) {
      result = absl::ResourceExhaustedError("out of memory while voxelizing");
    }
  });
  return result;
}

}  // namespace voxelpipe
