// The pipeline, stage by stage.
//
// Source: J. Pantaleoni, "VoxelPipe: A Programmable Pipeline for 3D Voxelization", HPG 2011, sections 3 (sort-middle,
// blending) and 4 (sort-last, A-buffer).
#include "pipeline/voxelize.h"

#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "pipeline/plan/list_memory.h"
#include "pipeline/plan/list_refusal.h"
#include "pipeline/run.h"
#include "pipeline/run_plan.h"
#include "pipeline/slab_loop.h"
#include "pipeline/stages/bind.h"
#include "pipeline/stages/stage_clock.h"
#include "pipeline/stages/stages.h"
#include "pipeline/warnings.h"

namespace voxelpipe {
namespace {

// Sort-middle on the CPU: triangles by tile; coverage, fragment shading and blending tile by tile; the inside. CUDA
// sorts no tiles (cuda/README.md).
absl::Status RasterizeSlab(Stages& stages, const VoxelizeRequest& request, const Slab& slab, StageClock& clock) {
  absl::Status s = stages.SortTriangles(slab, clock);  // coarse_raster, tile_sort
  if (s.ok() && FillsParts(request)) s = clock("fill", [&] { return stages.FindOwners(slab); });
  if (s.ok()) s = clock("fine_raster", [&] { return stages.FineRaster(slab); });
  if (s.ok() && request.fill != Fill::kNone) s = clock("fill", [&] { return stages.SolidFill(); });
  return s;
}

// Sort-last: every fragment is listed, sorted by voxel, and shaded where it stands.
absl::Status BucketSlab(Stages& stages, const Slab& slab, StageClock& clock) {
  absl::Status s = stages.SortTriangles(slab, clock);
  if (s.ok()) s = clock("emit", [&] { return stages.EmitFragments(slab); });
  if (s.ok()) s = clock("sort", [&] { return stages.SortFragments(); });
  if (s.ok()) s = clock("resolve", [&] { return stages.Resolve(); });
  return s;
}

absl::StatusOr<MadeSlab> MakeSlab(Stages& stages, const VoxelizeRequest& request, const Slab& slab, bool counted,
                                  bool on_device, StageClock& clock) {
  const bool buckets = request.result == ResultKind::kBuckets;
  absl::Status s = buckets ? BucketSlab(stages, slab, clock) : RasterizeSlab(stages, request, slab, clock);
  if (!s.ok()) return s;
  const SlabCounts counts = counted ? stages.Counts(clock) : SlabCounts();
  absl::StatusOr<SlabArrays> arrays =
      clock(LastStage(request), [&] { return on_device ? stages.FinishOnDevice() : stages.Finish(); });
  if (!arrays.ok()) return arrays.status();
  return MadeSlab{*std::move(arrays), counts};
}

}  // namespace

absl::Status RunPipeline(const RunInput& run, Assembler& assembler, VoxelizeStats& stats) {
  const VoxelizeRequest& request = run.request;
  const Backend& backend = run.backend;
  const absl::StatusOr<BoundRequest> bound = BindRequest(run.job, run.mesh, request);
  if (!bound.ok()) return bound.status();
  stats.warnings = WarningsOf(run.mesh, *bound);
  if (absl::Status s = CheckStrict(request, stats.warnings); !s.ok()) return s;
  std::optional<ListMemory> lists;  // before the stages, which ask it to their end
  absl::StatusOr<std::unique_ptr<Stages>> started = backend.Start(run.mesh, *bound, run.job);
  if (!started.ok()) return started.status();
  Stages& stages = **started;
  stats.triangles = run.mesh.triangles.size();
  stats.backend = std::string(backend.name());
  stats.simd = std::string(stages.simd());
  StageClock clock(run.job, stats);

  absl::StatusOr<MeshExtent> extent = clock("vertex_shade", [&] { return stages.VertexShade(); });
  if (!extent.ok()) return extent.status();
  stats.triangles_outside = extent->triangles_outside;
  const MeshSize size{run.mesh.triangles.size(), run.mesh.positions.size(), *std::move(extent)};
  const RunPlanner planner(backend, stages, request, size, run.limits, run.delivery);
  absl::StatusOr<PlannedRun> planned = clock("plan", [&] { return planner.Make(); });
  if (!planned.ok()) return planned.status();
  Plan& plan = planned->plan;
  AddParts(bound->part_table, plan);
  if (run.on_plan) {
    clock.Pause();
    if (absl::Status refused = run.on_plan(plan); !refused.ok()) return refused;
  }

  lists.emplace(run.job.memory(), plan.list_bytes, planner.RoomBeyond(plan));
  stages.Begin(plan.grid, planned->surface, &*lists);
  const auto make = [&](const Slab& slab, bool counted) {
    const bool stays = run.on_device && request.result == ResultKind::kDense && slab.depth() == plan.grid.dims[2];
    return MakeSlab(stages, request, slab, counted, stays, clock);
  };
  const absl::Status s = SlabLoop(run, *bound, plan, *lists, clock, stats).Run(make, assembler);
  stats.path = stages.Paths();
  return IsRefusedBeyondPlan(s) ? planner.Explain(plan, planned->surface, lists->refused_bytes()) : s;
}

}  // namespace voxelpipe
