#include "pipeline/run_plan.h"

#include <optional>
#include <utility>

#include "pipeline/footprint.h"

namespace voxelpipe {

absl::StatusOr<PlannedRun> RunPlanner::Make() const {
  absl::StatusOr<PlannedRun> run = PlanOn(backend_, request_, mesh_, Measure(), limits_, delivery_);
  if (run.ok()) FitToDevice(*run);
  return run;
}

// The device is asked only where its room is in doubt.
void RunPlanner::FitToDevice(PlannedRun& run) const {
  Plan& plan = run.plan;
  constexpr uint64_t kShareInDoubt = 8;
  const uint64_t all = backend_.memory_bytes();
  if (all == 0) return;
  if (PredictSlabBytes(request_, plan.grid, mesh_, run.surface, plan.slab_depth) < all / kShareInDoubt) return;
  const std::optional<uint64_t> room = stages_.FreeBytes();
  if (!room) return;
  PlanLimits limits = limits_;
  limits.slab_depth = FittingSlabDepth(request_, plan.grid, mesh_, run.surface, plan.slab_depth, *room);
  if (limits.slab_depth == plan.slab_depth) return;
  const Footprint need = backend_.Predict(request_, plan.grid, mesh_, run.surface, limits, delivery_);
  plan.slab_depth = limits.slab_depth;
  plan.peak_bytes = need.peak_bytes;
  plan.list_bytes = need.list_bytes;
}

absl::Status RunPlanner::Explain(const Plan& plan, uint64_t refused_bytes) const {
  const uint64_t need = plan.peak_bytes + refused_bytes;
  return GridTooLarge(backend_, request_, mesh_, Measure(), limits_, delivery_, plan.grid, false, need,
                      double(need) / double(plan.peak_bytes));
}

}  // namespace voxelpipe
