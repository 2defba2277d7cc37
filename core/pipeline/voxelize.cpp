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
#include "pipeline/stage_clock.h"
#include "pipeline/stages/bind.h"
#include "pipeline/stages/stages.h"
#include "pipeline/warnings.h"

namespace voxelpipe {
namespace {

// Sort-middle: which triangles may touch which tiles. Where no tiles are sorted, this prepares the next stage.
absl::Status SortTriangles(Stages& stages, const GridSpec& grid, const Slab& layers, bool buckets, StageClock& clock) {
  const bool tiles = stages.SortsTiles(grid);
  const char* const next = buckets ? "emit" : "fine_raster";
  absl::Status s = clock(tiles ? "coarse_raster" : next, [&] { return stages.CoarseRaster(grid, layers); });
  if (s.ok() && tiles) s = clock("tile_sort", [&] { return stages.TileSort(); });
  return s;
}

// Coverage, fragment shading and blending in fast memory, tile by tile; then the inside.
absl::Status RasterizeSlab(Stages& stages, const VoxelizeRequest& request, const Slab& slab, StageClock& clock) {
  absl::Status s = clock("fine_raster", [&] { return stages.BeginSlab(slab); });
  if (s.ok()) s = clock("fine_raster", [&] { return stages.FineRaster(); });
  if (s.ok() && request.fill != Fill::kNone) s = clock("fill", [&] { return stages.SolidFill(); });
  return s;
}

// Sort-last: every fragment is listed, sorted by voxel, and shaded where it stands.
absl::Status BucketSlab(Stages& stages, const Slab& slab, StageClock& clock) {
  absl::Status s = clock("emit", [&] { return stages.BeginSlab(slab); });
  if (s.ok()) s = clock("emit", [&] { return stages.EmitFragments(); });
  if (s.ok()) s = clock("sort", [&] { return stages.SortFragments(); });
  if (s.ok()) s = clock("resolve", [&] { return stages.Resolve(); });
  return s;
}

void AddCounts(const Stages& stages, const VoxelizeRequest& request, VoxelizeStats& stats) {
  const SlabCounts counts = stages.counts();
  stats.occupied += stages.CountOccupied();
  if (counts.fragments) stats.fragments = stats.fragments.value_or(0) + *counts.fragments;
  if (request.coverage == Coverage::kNone) stats.fragments = 0;
  if (CastsLines(request.fill)) stats.odd_columns = stats.odd_columns.value_or(0) + counts.odd_columns;
}

// Adds the slab's counts, whose time is the last stage's only where counting waits for it.
absl::Status CountSlab(const Stages& stages, const VoxelizeRequest& request, StageClock& clock, VoxelizeStats& stats) {
  const auto count = [&] {
    AddCounts(stages, request, stats);
    return absl::OkStatus();
  };
  if (stages.counts_wait()) return clock(LastStage(request), count);
  clock.Pause();
  return count();
}

// The slab's arrays in their result format; those of one slab among several may still be on their way.
absl::StatusOr<SlabArrays> FinishSlab(Stages& stages, bool whole) {
  if (!whole) return stages.FinishLater();
  absl::StatusOr<ResultArrays> arrays = stages.Finish();
  if (!arrays.ok()) return arrays.status();
  return SlabArrays(*std::move(arrays));
}

}  // namespace

absl::Status RunPipeline(const RunInput& run, Assembler& assembler, VoxelizeStats& stats) {
  const VoxelizeRequest& request = run.request;
  const absl::StatusOr<BoundRequest> bound = BindRequest(run.mesh, request);
  if (!bound.ok()) return bound.status();
  stats.warnings = WarningsOf(run.mesh, request);
  if (absl::Status s = CheckStrict(request, stats.warnings); !s.ok()) return s;
  std::optional<ListMemory> lists;  // before the stages, which ask it to their end
  absl::StatusOr<std::unique_ptr<Stages>> started = run.backend.Start(run.mesh, *bound, run.job);
  if (!started.ok()) return started.status();
  Stages& stages = **started;
  stats.triangles = run.mesh.triangles.size();
  stats.backend = std::string(run.backend.name());
  stats.simd = std::string(stages.simd());
  StageClock clock(run.job, stats);

  absl::StatusOr<MeshExtent> extent = clock("vertex_shade", [&] { return stages.VertexShade(); });
  if (!extent.ok()) return extent.status();
  const MeshSize size{run.mesh.triangles.size(), run.mesh.positions.size(), *std::move(extent)};
  const RunPlanner planner(run.backend, stages, request, size, run.limits, run.delivery);
  absl::StatusOr<PlannedRun> planned = clock("vertex_shade", [&] { return planner.Make(); });
  if (!planned.ok()) return planned.status();
  if (run.on_plan) {
    clock.Pause();
    if (absl::Status refused = run.on_plan(planned->plan); !refused.ok()) return refused;
  }

  Plan& plan = planned->plan;
  lists.emplace(run.job.memory(), plan.list_bytes, planner.RoomBeyond(plan));
  stages.SetLists(planned->surface, &*lists);
  const bool buckets = request.result == ResultKind::kBuckets;
  SlabLoop slabs(run, stages, plan, *lists, clock, stats);
  const SlabLoop::Steps steps{
      .sort = [&](const Slab& layers) { return SortTriangles(stages, plan.grid, layers, buckets, clock); },
      .make = [&](const Slab& slab, bool whole, bool counts) -> absl::StatusOr<SlabArrays> {
        absl::Status s = buckets ? BucketSlab(stages, slab, clock) : RasterizeSlab(stages, request, slab, clock);
        if (s.ok() && counts) s = CountSlab(stages, request, clock, stats);
        if (!s.ok()) return s;
        return clock(LastStage(request), [&] { return FinishSlab(stages, whole); });
      }};
  const absl::Status s = slabs.Run(steps, assembler);
  stats.path = stages.Paths();
  return IsRefusedBeyondPlan(s) ? planner.Explain(plan, lists->refused_bytes()) : s;
}

}  // namespace voxelpipe
