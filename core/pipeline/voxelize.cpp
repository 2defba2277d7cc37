// The pipeline, stage by stage. Source: J. Pantaleoni, "VoxelPipe: A Programmable Pipeline for 3D Voxelization", HPG 2011,
// sections 3 (sort-middle, blending) and 4 (sort-last, A-buffer).
#include "pipeline/voxelize.h"

#include <ctime>

#include <algorithm>
#include <memory>
#include <new>
#include <optional>
#include <tuple>
#include <utility>

#include <tbb/task_arena.h>

#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "base/wall_clock.h"
#include "pipeline/assemble.h"
#include "pipeline/backend.h"
#include "pipeline/bind.h"
#include "pipeline/footprint.h"
#include "pipeline/list_memory.h"
#include "pipeline/planner.h"
#include "pipeline/resuming_sink.h"
#include "pipeline/stages.h"
#include "pipeline/warnings.h"

namespace voxelpipe {
namespace {

// CPU time of the whole process: with one job at a time, that job's on all its threads. Of this thread where the run has no other: to ask for
// the process's takes microseconds in a server of many threads.
double CpuMs() {
  timespec t;
  const bool alone = tbb::this_task_arena::max_concurrency() == 1;
  clock_gettime(alone ? CLOCK_THREAD_CPUTIME_ID : CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) * 1e3 + double(t.tv_nsec) * 1e-6;
}

// Runs one stage: asks first whether the job may go on, reports progress, keeps the time. CPU time is read anew only after a
// pause between stages: with many threads in the process that costs as much as a stage of a small job.
class StageClock {
 public:
  StageClock(const JobContext& job, VoxelizeStats& stats) : job_(job), stats_(stats) {}

  template <typename Stage>
  auto operator()(const char* name, Stage&& stage) -> decltype(stage()) {
    if (absl::Status s = job_.Check(); !s.ok()) return s;
    const bool continued =
        std::any_of(stats_.stages.begin(), stats_.stages.end(), [&](const auto& known) { return known.first == name; });
    if (!continued) {
      job_.Report(name, 0);
      stats_.stages.emplace_back(name, 0.0);
    }
    const double wall = WallMs();
    if (!running_) cpu_begin_ = CpuMs();
    running_ = true;
    auto result = stage();
    const double ms = WallMs() - wall;
    stats_.voxelize_ms += ms;
    std::find_if(stats_.stages.begin(), stats_.stages.end(), [&](const auto& s) { return s.first == name; })->second +=
        ms;
    return result;
  }
  void Done(const char* name, double fraction) { job_.Report(name, fraction); }
  // What is done until the next stage does not count as CPU time.
  void Pause() {
    if (running_) stats_.voxelize_cpu_ms += CpuMs() - cpu_begin_;
    running_ = false;
  }

 private:
  const JobContext& job_;
  VoxelizeStats& stats_;
  bool running_ = false;
  double cpu_begin_ = 0;
};

void AddCounts(const Stages& stages, const VoxelizeRequest& request, VoxelizeStats& stats) {
  const SlabCounts counts = stages.counts();
  stats.occupied += stages.CountOccupied();
  if (counts.fragments) stats.fragments = stats.fragments.value_or(0) + *counts.fragments;
  if (request.coverage == Coverage::kNone) stats.fragments = 0;
  if (CastsLines(request.fill)) stats.odd_columns = stats.odd_columns.value_or(0) + counts.odd_columns;
}

// The stages of one slab, in the paper's order. Adds its counts to `stats`, if given.
// `all`: there is no other slab.
absl::StatusOr<SlabArrays> RunSlab(Stages& stages, const VoxelizeRequest& request, const Slab& slab, bool all,
                                   StageClock& run, VoxelizeStats* stats) {
  const bool buckets = request.result == ResultKind::kBuckets;
  absl::Status s = run(buckets ? "emit" : "fine_raster", [&] { return stages.BeginSlab(slab); });
  if (!s.ok()) return s;
  if (buckets) {  // sort-last
    s = run("emit", [&] { return stages.EmitFragments(); });
    if (!s.ok()) return s;
    s = run("sort", [&] { return stages.SortFragments(); });
    if (!s.ok()) return s;
    s = run("resolve", [&] { return stages.Resolve(); });
    if (!s.ok()) return s;
  } else {  // sort-middle
    s = run("fine_raster", [&] { return stages.FineRaster(); });
    if (!s.ok()) return s;
    if (request.fill != Fill::kNone) {
      s = run("fill", [&] { return stages.SolidFill(); });
      if (!s.ok()) return s;
    }
  }
  const char* const last = buckets ? "resolve" : request.fill == Fill::kNone ? "fine_raster" : "fill";
  if (stats != nullptr) {
    const auto count = [&] {
      AddCounts(stages, request, *stats);
      return absl::OkStatus();
    };
    if (stages.counts_wait()) {
      s = run(last, count);
      if (!s.ok()) return s;
    } else {
      run.Pause();
      (void)count();
    }
  }
  // Bringing the arrays into their result format ends whichever stage wrote them last.
  return run(last, [&]() -> absl::StatusOr<SlabArrays> {
    if (!all) return stages.FinishLater();
    absl::StatusOr<ResultArrays> arrays = stages.Finish();
    if (!arrays.ok()) return arrays.status();
    return SlabArrays(*std::move(arrays));
  });
}

// The plan's slabs made as thin as the device has room for. Asked only where that is in doubt.
void FitToDevice(const Backend& backend, const Stages& stages, const VoxelizeRequest& request, const MeshSize& mesh,
                 PlanLimits limits, Delivery delivery, PlannedRun& run) {
  Plan& plan = run.plan;
  constexpr uint64_t kShareInDoubt = 8;
  const uint64_t all = backend.memory_bytes();
  if (all == 0 || PredictSlabBytes(request, plan.grid, mesh, run.surface, plan.slab_depth) < all / kShareInDoubt)
    return;
  const std::optional<uint64_t> room = stages.FreeBytes();
  if (!room) return;
  limits.slab_depth = FittingSlabDepth(request, plan.grid, mesh, run.surface, plan.slab_depth, *room);
  if (limits.slab_depth == plan.slab_depth) return;
  plan.slab_depth = limits.slab_depth;
  const Footprint need = backend.Predict(request, plan.grid, mesh, run.surface, limits, delivery);
  plan.peak_bytes = need.peak_bytes;
  plan.list_bytes = need.list_bytes;
}

// Layers of a slab to try in place of one that found no room on the device; 0 where it was as thin as can be, or something else was wrong.
int64_t HalfOf(const Slab& slab, const absl::Status& why) {
  if (DeviceFailureOf(why) != DeviceFailureKind::kOutOfMemory || slab.depth() <= kSlabGranularity) return 0;
  return (slab.depth() / 2 + kSlabGranularity - 1) / kSlabGranularity * kSlabGranularity;
}

absl::Status RunStages(const Backend& backend, const TriangleMesh& mesh, const BoundRequest& bound,
                       const JobContext& job, const PlanLimits& limits, Delivery delivery, const PlanHook& on_plan,
                       Assembler& assembler, VoxelizeStats& stats) {
  const VoxelizeRequest& request = bound.request;
  stats.triangles = mesh.triangles.size();
  stats.backend = std::string(backend.name());
  StageClock run(job, stats);

  absl::StatusOr<std::unique_ptr<Stages>> started = backend.Start(mesh, bound, job);
  if (!started.ok()) return started.status();
  Stages& stages = **started;
  stats.simd = std::string(stages.simd());

  absl::StatusOr<MeshExtent> extent = run("vertex_shade", [&] { return stages.VertexShade(); });
  if (!extent.ok()) return extent.status();
  const MeshSize size{mesh.triangles.size(), mesh.positions.size(), *std::move(extent)};
  const MeasureGrid measure = [&](const GridSpec& grid, bool closely) { return stages.Measure(grid, size, closely); };
  absl::StatusOr<PlannedRun> planned =
      run("vertex_shade", [&] { return PlanOn(backend, request, size, measure, limits, delivery); });
  if (!planned.ok()) return planned.status();
  Plan* const plan = &planned->plan;
  FitToDevice(backend, stages, request, size, limits, delivery, *planned);
  if (on_plan) {
    run.Pause();
    if (absl::Status refused = on_plan(*plan); !refused.ok()) return refused;
  }
  ListMemory lists(job.memory(), plan->list_bytes,
                   limits.max_working_bytes - std::min(limits.max_working_bytes, plan->peak_bytes));
  stages.SetLists(planned->surface, &lists);
  // Says of a stage that came to need more than the plan's limits what would fit.
  const auto explained = [&](const absl::Status& why) {
    if (lists.refused_bytes() == 0 || !absl::IsResourceExhausted(why)) return why;
    const uint64_t need = plan->peak_bytes + lists.refused_bytes();
    return GridTooLarge(backend, request, size, measure, limits, delivery, plan->grid, false, need,
                        double(need) / double(plan->peak_bytes));
  };
  const int64_t depth = plan->grid.dims[2];
  const bool buckets = request.result == ResultKind::kBuckets;
  const char* last = buckets ? "resolve" : request.fill == Fill::kNone ? "fine_raster" : "fill";
  const bool timed = delivery == Delivery::kMemory;  // a sink's time is not the pipeline's

  const bool tiles = stages.SortsTiles(plan->grid), by_slab = tiles && stages.SortsTilesBySlab();
  const auto slab_from = [&](int64_t z) { return Slab{z, std::min(depth, z + plan->slab_depth)}; };
  Slab sorted;  // layers whose triangles are sorted by tile
  const auto sort = [&](const Slab& layers) -> absl::Status {
    sorted = Slab();
    absl::Status s =
        run(tiles ? "coarse_raster" : "fine_raster", [&] { return stages.CoarseRaster(plan->grid, layers); });
    if (s.ok() && tiles) s = run("tile_sort", [&] { return stages.TileSort(); });
    if (s.ok()) sorted = layers;
    return s;
  };
  // Before the assembler begins: what is wrong with the mesh shows here.
  absl::Status s = sort(by_slab ? slab_from(0) : Slab{0, depth});
  while (by_slab && !s.ok()) {
    const int64_t half = HalfOf(slab_from(0), s);
    if (half == 0 || !stages.AbandonSlab()) break;
    plan->slab_depth = half;
    s = sort(slab_from(0));
  }
  if (!s.ok()) return explained(s);
  if (s = assembler.Begin(request, *plan); !s.ok()) return s;
  // While a slab's arrays come from the device and are added, the next slab is worked on.
  struct Coming {
    int pass;
    Slab slab;
    SlabArrays arrays;
  };
  std::optional<Coming> coming;
  const auto add = [&]() -> absl::Status {
    if (!coming) return absl::OkStatus();
    const auto wait_and_add = [&]() -> absl::Status {
      absl::StatusOr<ResultArrays> arrays = std::move(coming->arrays).Take();
      if (!arrays.ok()) return arrays.status();
      if (request.result != ResultKind::kDense) lists.Hold(arrays->bytes());
      return assembler.Add(coming->pass, coming->slab, *std::move(arrays));
    };
    if (!timed) run.Pause();
    absl::Status added = timed ? run(last, wait_and_add) : wait_and_add();
    coming.reset();
    return added;
  };
  for (int pass = 0; pass < assembler.passes(); ++pass) {
    for (int64_t z = 0; z < depth;) {
      const Slab slab = slab_from(z);
      const bool all = slab.depth() == depth;
      const auto before = std::tuple(stats.occupied, stats.fragments, stats.odd_columns);
      const auto make = [&]() -> absl::StatusOr<SlabArrays> {
        if (by_slab && slab != sorted) {
          if (absl::Status unsorted = sort(slab); !unsorted.ok()) return unsorted;
        }
        return RunSlab(stages, request, slab, all, run, pass == 0 ? &stats : nullptr);
      };
      absl::StatusOr<SlabArrays> arrays = make();
      if (!arrays.ok()) {  // where the device has no room: thinner slabs from here on
        const int64_t half = HalfOf(slab, arrays.status());
        if (half == 0) return explained(arrays.status());
        if (s = add(); !s.ok()) return s;
        if (!stages.AbandonSlab()) return arrays.status();
        std::tie(stats.occupied, stats.fragments, stats.odd_columns) = before;
        sorted = Slab();
        plan->slab_depth = half;
        if (all) s = assembler.Begin(request, *plan);  // it expected one slab
        if (!s.ok()) return s;
        continue;
      }
      z = slab.end;
      run.Done(last, (double(pass) + double(slab.end) / double(depth)) / double(assembler.passes()));
      // Asked here too: a sink may take long, and a client may have gone meanwhile.
      if (s = job.Check(); !s.ok()) return s;
      if (s = add(); !s.ok()) return s;
      coming.emplace(Coming{pass, slab, *std::move(arrays)});
      if (!coming->arrays.there()) continue;
      if (s = add(); !s.ok()) return s;
    }
  }
  if (s = add(); !s.ok()) return s;
  if (s = lists.Need(assembler.bytes_to_join()); !s.ok()) return explained(s);
  s = timed ? run(last, [&] { return assembler.End(); }) : assembler.End();
  run.Pause();
  return s;
}

// RunStages inside the backend's arena, with what a run may throw as a status.
absl::Status RunInside(const Backend& backend, const TriangleMesh& mesh, const VoxelizeRequest& request,
                       const JobContext& job, const PlanLimits& limits, Delivery delivery, const PlanHook& on_plan,
                       Assembler& assembler, VoxelizeStats& stats) {
  try {
    const absl::StatusOr<BoundRequest> bound = BindRequest(mesh, request);
    if (!bound.ok()) return bound.status();
    stats.warnings = WarningsOf(mesh, request);
    absl::Status s = CheckStrict(request, stats.warnings);
    if (s.ok()) s = RunStages(backend, mesh, *bound, job, limits, delivery, on_plan, assembler, stats);
    if (!s.ok()) return s;
    AddRunWarnings(mesh, request, stats);
    return CheckStrict(request, stats.warnings);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory while voxelizing");
  }
}

}  // namespace

absl::StatusOr<VoxelizeResult> VoxelizeInside(const Backend& backend, const TriangleMesh& mesh,
                                              const VoxelizeRequest& request, const JobContext& job,
                                              const PlanLimits& limits, const PlanHook& on_plan) {
  MemoryAssembler assembler;
  VoxelizeStats stats;
  const absl::Status s = RunInside(backend, mesh, request, job, limits, Delivery::kMemory, on_plan, assembler, stats);
  if (!s.ok()) return s;
  VoxelizeResult result = assembler.Take();
  result.stats = std::move(stats);
  return result;
}

absl::StatusOr<VoxelizeResult> VoxelizeOn(const Backend& backend, const TriangleMesh& mesh,
                                          const VoxelizeRequest& request, const JobContext& job,
                                          const PlanLimits& limits, const PlanHook& on_plan) {
  absl::StatusOr<VoxelizeResult> result = absl::UnknownError("the run did not start");
  backend.Run(request.threads, [&] { result = VoxelizeInside(backend, mesh, request, job, limits, on_plan); });
  return result;
}

absl::StatusOr<VoxelizeStats> VoxelizeOnTo(const Backend& backend, const TriangleMesh& mesh,
                                           const VoxelizeRequest& request, const JobContext& job,
                                           const PlanLimits& limits, ResultSink& sink, const PlanHook& on_plan) {
  VoxelizeStats stats;
  if (request.result == ResultKind::kDense) {
    StreamAssembler assembler(sink);
    absl::Status s = absl::UnknownError("the run did not start");
    backend.Run(request.threads, [&] {
      s = RunInside(backend, mesh, request, job, limits, Delivery::kStream, on_plan, assembler, stats);
    });
    if (!s.ok()) return s;
    return stats;
  }
  absl::StatusOr<VoxelizeResult> result = VoxelizeOn(backend, mesh, request, job, limits, on_plan);
  if (!result.ok()) return result.status();
  stats = std::move(result->stats);
  if (sink.Keep(*std::move(result))) return stats;
  if (absl::Status s = WriteTo(*result, sink); !s.ok()) return s;  // NOLINT(bugprone-use-after-move): it was not kept
  return stats;
}

namespace {

// Tells of the first plan alone.
PlanHook TellOnce(const std::function<void(const Plan&)>& on_plan) {
  if (!on_plan) return {};
  return [&on_plan, told = std::make_shared<bool>(false)](const Plan& plan) {
    if (!std::exchange(*told, true)) on_plan(plan);
    return absl::OkStatus();
  };
}

// Where any device may do a request and this one failed by no fault of the request's: the one that does it instead, or null.
const Backend* InsteadOf(const Backend& backend, BackendChoice choice, const absl::Status& status) {
  if (choice != BackendChoice::kAuto || status.ok() || !DeviceFailureOf(status)) return nullptr;
  const absl::StatusOr<const Backend*> cpu = SelectBackend(BackendChoice::kCpu);
  return cpu.ok() && *cpu != &backend ? *cpu : nullptr;
}

std::string Words(const Backend& backend, const absl::Status& failure) {
  return absl::StrCat(backend.device(), ": ", failure.message());
}

VoxelizeStats& StatsOf(VoxelizeResult& result) {
  return result.stats;
}
VoxelizeStats& StatsOf(VoxelizeStats& stats) {
  return stats;
}

// run(backend, whether another one was tried before) on what the request chooses, and then, where that may help, on what does it instead.
template <typename Run>
auto RunOnChosen(const VoxelizeRequest& request, Run&& run) -> decltype(run(std::declval<const Backend&>(), false)) {
  // Said first of all that is wrong with a request, whatever this machine has.
  if (absl::Status s = ValidateRequest(request); !s.ok()) return s;
  const absl::StatusOr<const Backend*> backend = SelectBackend(request.backend);
  if (!backend.ok()) return backend.status();
  auto result = run(**backend, false);
  const Backend* const other = InsteadOf(**backend, request.backend, result.status());
  if (other == nullptr) return result;
  const std::string failure = Words(**backend, result.status());
  result = run(*other, true);
  if (result.ok()) {
    StatsOf(*result).device_failure = failure;
    return result;
  }
  const absl::Status& status = result.status();
  return absl::Status(status.code(), absl::StrCat(status.message(), "; tried before, ", failure));
}

}  // namespace

absl::StatusOr<VoxelizeResult> Voxelize(const TriangleMesh& mesh, const VoxelizeRequest& request, const JobContext& job,
                                        const PlanLimits& limits, const std::function<void(const Plan&)>& on_plan) {
  const PlanHook tell = TellOnce(on_plan);
  return RunOnChosen(
      request, [&](const Backend& backend, bool) { return VoxelizeOn(backend, mesh, request, job, limits, tell); });
}

absl::StatusOr<VoxelizeStats> VoxelizeTo(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                         const JobContext& job, const PlanLimits& limits, ResultSink& sink,
                                         const std::function<void(const Plan&)>& on_plan) {
  const PlanHook tell = TellOnce(on_plan);
  ResumingSink resuming(sink);
  return RunOnChosen(request, [&](const Backend& backend, bool again) {
    if (again) resuming.Restart();
    return VoxelizeOnTo(backend, mesh, request, job, limits, resuming, tell);
  });
}

}  // namespace voxelpipe
