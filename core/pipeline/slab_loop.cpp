#include "pipeline/slab_loop.h"

#include <algorithm>
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

absl::Status SlabLoop::GoOnThinner(const Slab& slab, const absl::Status& why, Assembler& assembler) {
  const int64_t half = HalfOf(slab, why);
  if (half == 0) return why;
  plan_.slab_depth = half;
  return AddComing(assembler);
}

void SlabLoop::AddCounts(const SlabCounts& counts) {
  stats_.occupied += counts.occupied;
  if (counts.fragments) stats_.fragments = stats_.fragments.value_or(0) + *counts.fragments;
  if (run_.request.coverage == Coverage::kNone) stats_.fragments = 0;
  if (CastsLines(run_.request.fill)) stats_.odd_columns = stats_.odd_columns.value_or(0) + counts.odd_columns;
  for (size_t i = 0; i < parts_.voxels.size(); ++i) {
    const uint32_t rank = bound_.parts->parts[i].rank;
    parts_.odd_columns[i] += counts.part_odd_columns[rank];
    parts_.voxels[i] += counts.part_voxels[rank];
  }
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

absl::Status SlabLoop::RunPass(const MakeSlab& make, int pass, Assembler& assembler) {
  const int64_t depth = plan_.grid.dims[2];
  for (int64_t z = 0; z < depth;) {
    const Slab slab{z, std::min(depth, z + plan_.slab_depth)};
    absl::StatusOr<MadeSlab> made = make(slab, /*counted=*/pass == 0);
    if (!made.ok()) {
      if (absl::Status s = GoOnThinner(slab, made.status(), assembler); !s.ok()) return s;
      continue;
    }
    if (pass == 0) AddCounts(made->counts);
    if (pass == 0 && z == 0) {  // not before: what is wrong with the mesh shows by now, and how thick slabs can be
      if (absl::Status s = assembler.Begin(run_.request, plan_, parts_); !s.ok()) return s;
      stats_.passes = assembler.passes();
    }
    z = slab.end;
    clock_.Done(LastStage(run_.request), (double(pass) + double(z) / double(depth)) / double(assembler.passes()));
    // Asked here too: a sink may take long, and a client may have gone meanwhile.
    if (absl::Status s = run_.job.Check(); !s.ok()) return s;
    if (absl::Status s = AddComing(assembler); !s.ok()) return s;
    coming_.emplace(Coming{pass, slab, std::move(made->arrays)});
    if (!coming_->arrays.there()) continue;
    if (absl::Status s = AddComing(assembler); !s.ok()) return s;
  }
  return absl::OkStatus();
}

absl::Status SlabLoop::Run(const MakeSlab& make, Assembler& assembler) {
  int pass = 0;
  do {
    if (absl::Status s = RunPass(make, pass, assembler); !s.ok()) return s;
  } while (++pass < assembler.passes());
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
