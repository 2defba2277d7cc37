// The slabs of one run, one after the other.
//
// While the arrays of a slab come from the device and are added to the result, the next one is made. Where the device
// has no room for a slab, it and those behind it are made thinner.
#pragma once

#include <algorithm>
#include <functional>
#include <optional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "pipeline/plan/list_memory.h"
#include "pipeline/plan/plan.h"
#include "pipeline/run.h"
#include "pipeline/stage_clock.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe {

class SlabLoop {
 public:
  // What is done with layers of the grid.
  struct Steps {
    // Finds the triangles of these layers' tiles, and sorts them by tile.
    std::function<absl::Status(const Slab& layers)> sort;
    // The stages of one slab whose triangles are sorted. `whole`: there is no other slab. `counts`: its counts are
    // added to the run's.
    std::function<absl::StatusOr<SlabArrays>(const Slab& slab, bool whole, bool counts)> make;
  };

  // `plan.slab_depth` becomes less where slabs are made thinner. All that is given outlives the loop.
  SlabLoop(const RunInput& run, Stages& stages, Plan& plan, ListMemory& lists, StageClock& clock, VoxelizeStats& stats)
      : run_(run), stages_(stages), plan_(plan), lists_(lists), clock_(clock), stats_(stats) {}

  // Begins `assembler`, adds all slabs to it as often as it wants, and ends it.
  absl::Status Run(const Steps& steps, Assembler& assembler);

 private:
  struct Coming {
    int pass;
    Slab slab;
    SlabArrays arrays;
  };

  Slab SlabFrom(int64_t z) const { return {z, std::min(plan_.grid.dims[2], z + plan_.slab_depth)}; }
  bool SortsBySlab() const { return stages_.SortsTiles(plan_.grid) && stages_.SortsTilesBySlab(); }
  absl::Status Sort(const Steps& steps, const Slab& layers);
  absl::Status SortFirst(const Steps& steps);
  absl::StatusOr<SlabArrays> Make(const Steps& steps, const Slab& slab, int pass);
  // The slab found no room: from here on slabs are thinner. The error where that does not help.
  absl::Status GoOnThinner(const Slab& slab, const absl::Status& why, Assembler& assembler);
  // Adds the slab whose arrays are being copied, if there is one.
  absl::Status AddComing(Assembler& assembler);
  bool OnDevice() const { return run_.backend.memory_bytes() > 0; }
  // Of a slab's lists until the end of the run. Those of a device are pinned: their pool keeps them while they are
  // joined.
  uint64_t HeldBytes(const ResultArrays& lists, const Slab& slab) const;
  absl::Status RunPass(const Steps& steps, int pass, Assembler& assembler);

  const RunInput& run_;
  Stages& stages_;
  Plan& plan_;
  ListMemory& lists_;
  StageClock& clock_;
  VoxelizeStats& stats_;
  Slab sorted_;  // layers whose triangles are sorted by tile
  std::optional<Coming> coming_;
};

// The stage that writes a slab's arrays last. Bringing them into their result format is part of it.
const char* LastStage(const VoxelizeRequest& request);

}  // namespace voxelpipe
