// The slabs of one run, one after the other.
//
// While the arrays of a slab come from the device and are added to the result, the next one is made. Where the device
// has no room for a slab, it and those behind it are made thinner.
#pragma once

#include <functional>
#include <optional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "pipeline/plan/list_memory.h"
#include "pipeline/plan/plan.h"
#include "pipeline/run.h"
#include "pipeline/stages/stage_clock.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe {

// A slab whose stages have run.
struct MadeSlab {
  SlabArrays arrays;
  SlabCounts counts;
};

class SlabLoop {
 public:
  // The stages of one slab. `counted`: its counts are wanted.
  using MakeSlab = std::function<absl::StatusOr<MadeSlab>(const Slab& slab, bool counted)>;

  // `plan.slab_depth` becomes less where slabs are made thinner. All that is given outlives the loop.
  SlabLoop(const RunInput& run, const BoundRequest& bound, Plan& plan, ListMemory& lists, StageClock& clock,
           VoxelizeStats& stats)
      : run_(run), bound_(bound), plan_(plan), lists_(lists), clock_(clock), stats_(stats), parts_(bound.part_table) {}

  // Makes the first slab, begins `assembler`, adds all slabs to it as often as it wants, and ends it.
  absl::Status Run(const MakeSlab& make, Assembler& assembler);

 private:
  struct Coming {
    int pass;
    Slab slab;
    SlabArrays arrays;
  };

  absl::Status RunPass(const MakeSlab& make, int pass, Assembler& assembler);
  // The slab found no room: from here on slabs are thinner. The error where that does not help.
  absl::Status GoOnThinner(const Slab& slab, const absl::Status& why, Assembler& assembler);
  void AddCounts(const SlabCounts& counts);
  // Adds the slab whose arrays are being copied, if there is one.
  absl::Status AddComing(Assembler& assembler);
  bool OnDevice() const { return run_.backend.memory_bytes() > 0; }
  // Of a slab's lists until the end of the run. Those of a device are pinned: their pool keeps them while they are
  // joined.
  uint64_t HeldBytes(const ResultArrays& lists, const Slab& slab) const;

  const RunInput& run_;
  const BoundRequest& bound_;
  Plan& plan_;
  ListMemory& lists_;
  StageClock& clock_;
  VoxelizeStats& stats_;
  PartTable parts_;  // with the counts of the slabs so far
  std::optional<Coming> coming_;
};

// The stage that writes a slab's arrays last. Bringing them into their result format is part of it.
const char* LastStage(const VoxelizeRequest& request);

}  // namespace voxelpipe
