#include "pipeline/slab_loop.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "base/device_failure.h"
#include "pipeline/plan/footprint_parts.h"

namespace voxelpipe {
namespace {

// Layers of a slab to try in place of one that found no room on the device; 0 where it was as thin as can be, or
// something else was wrong.
int64_t HalfOf(const Slab& slab, const absl::Status& why) {
  if (DeviceFailureOf(why) != DeviceFailureKind::kOutOfMemory || slab.depth() <= kSlabGranularity) return 0;
  return (slab.depth() / 2 + kSlabGranularity - 1) / kSlabGranularity * kSlabGranularity;
}

}  // namespace

const char* LastStage(const VoxelizeRequest& request) {
  if (request.result == ResultKind::kBuckets) return "resolve";
  return request.fill == Fill::kNone ? "fine_raster" : "fill";
}

absl::Status SlabLoop::Sort(const Steps& steps, const Slab& layers) {
  sorted_ = Slab();
  if (absl::Status s = steps.sort(layers); !s.ok()) return s;
  sorted_ = layers;
  return absl::OkStatus();
}

absl::Status SlabLoop::SortFirst(const Steps& steps) {
  if (!SortsBySlab()) return Sort(steps, {0, plan_.grid.dims[2]});
  absl::Status s = Sort(steps, SlabFrom(0));
  while (!s.ok()) {
    const int64_t half = HalfOf(SlabFrom(0), s);
    if (half == 0 || !stages_.AbandonSlab()) break;
    plan_.slab_depth = half;
    s = Sort(steps, SlabFrom(0));
  }
  return s;
}

absl::StatusOr<SlabArrays> SlabLoop::Make(const Steps& steps, const Slab& slab, int pass) {
  if (SortsBySlab() && slab != sorted_) {
    if (absl::Status s = Sort(steps, slab); !s.ok()) return s;
  }
  return steps.make(slab, /*whole=*/slab.depth() == plan_.grid.dims[2], /*counts=*/pass == 0);
}

absl::Status SlabLoop::GoOnThinner(const Slab& slab, const absl::Status& why, Assembler& assembler) {
  const int64_t half = HalfOf(slab, why);
  if (half == 0) return why;
  if (absl::Status s = AddComing(assembler); !s.ok()) return s;
  if (!stages_.AbandonSlab()) return why;
  sorted_ = Slab();
  plan_.slab_depth = half;
  const bool whole = slab.depth() == plan_.grid.dims[2];  // the assembler expected one slab
  return whole ? assembler.Begin(run_.request, plan_) : absl::OkStatus();
}

uint64_t SlabLoop::HeldBytes(const ResultArrays& lists, const Slab& slab) const {
  const bool joined = slab.depth() < plan_.grid.dims[2];
  if (!joined || !OnDevice()) return lists.bytes();
  double pinned = 0;
  const auto add = [&](const HostBuffer& list) { pinned += footprint::PooledPinned(double(list.size())); };
  for (const HostBuffer& target : lists.targets) add(target);
  for (const HostBuffer* list : {&lists.bricks, &lists.masks, &lists.voxels, &lists.offsets, &lists.triangles})
    add(*list);
  return uint64_t(pinned) + lists.bytes();
}

absl::Status SlabLoop::AddComing(Assembler& assembler) {
  if (!coming_) return absl::OkStatus();
  const auto wait_and_add = [&]() -> absl::Status {
    absl::StatusOr<ResultArrays> arrays = std::move(coming_->arrays).Take();
    if (!arrays.ok()) return arrays.status();
    if (run_.request.result != ResultKind::kDense) lists_.Hold(HeldBytes(*arrays, coming_->slab));
    return assembler.Add(coming_->pass, coming_->slab, *std::move(arrays));
  };
  const bool timed = run_.delivery == Delivery::kMemory;  // a sink's time is not the pipeline's
  if (!timed) clock_.Pause();
  absl::Status added = timed ? clock_(LastStage(run_.request), wait_and_add) : wait_and_add();
  coming_.reset();
  return added;
}

absl::Status SlabLoop::RunPass(const Steps& steps, int pass, Assembler& assembler) {
  const int64_t depth = plan_.grid.dims[2];
  for (int64_t z = 0; z < depth;) {
    const Slab slab = SlabFrom(z);
    const auto counts = std::tuple(stats_.occupied, stats_.fragments, stats_.odd_columns);
    absl::StatusOr<SlabArrays> arrays = Make(steps, slab, pass);
    if (!arrays.ok()) {
      if (absl::Status s = GoOnThinner(slab, arrays.status(), assembler); !s.ok()) return s;
      std::tie(stats_.occupied, stats_.fragments, stats_.odd_columns) = counts;
      continue;
    }
    z = slab.end;
    clock_.Done(LastStage(run_.request), (double(pass) + double(z) / double(depth)) / double(assembler.passes()));
    // Asked here too: a sink may take long, and a client may have gone meanwhile.
    if (absl::Status s = run_.job.Check(); !s.ok()) return s;
    if (absl::Status s = AddComing(assembler); !s.ok()) return s;
    coming_.emplace(Coming{pass, slab, *std::move(arrays)});
    if (!coming_->arrays.there()) continue;
    if (absl::Status s = AddComing(assembler); !s.ok()) return s;
  }
  return absl::OkStatus();
}

absl::Status SlabLoop::Run(const Steps& steps, Assembler& assembler) {
  // Before the assembler begins: what is wrong with the mesh shows here.
  if (absl::Status s = SortFirst(steps); !s.ok()) return s;
  if (absl::Status s = assembler.Begin(run_.request, plan_); !s.ok()) return s;
  stats_.passes = assembler.passes();
  for (int pass = 0; pass < assembler.passes(); ++pass) {
    if (absl::Status s = RunPass(steps, pass, assembler); !s.ok()) return s;
  }
  if (absl::Status s = AddComing(assembler); !s.ok()) return s;
  if (!OnDevice()) {
    if (absl::Status s = lists_.Need(assembler.bytes_to_join()); !s.ok()) return s;
  }
  const auto end = [&] { return assembler.End(); };
  const absl::Status s = run_.delivery == Delivery::kMemory ? clock_(LastStage(run_.request), end) : end();
  clock_.Pause();
  return s;
}

}  // namespace voxelpipe
