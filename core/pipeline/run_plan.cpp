#include "pipeline/run_plan.h"

#include <optional>
#include <utility>

#include "pipeline/plan/footprint.h"

namespace voxelpipe {

absl::StatusOr<PlannedRun> RunPlanner::Make() const {
  absl::StatusOr<PlannedRun> run = PlanOn(input_);
  if (run.ok()) FitToDevice(*run);
  return run;
}

// The device is asked only where its room is in doubt.
void RunPlanner::FitToDevice(PlannedRun& run) const {
  constexpr uint64_t kShareInDoubt = 8;
  const VoxelizeRequest& request = input_.request;
  const MeshSize& mesh = input_.mesh;
  Plan& plan = run.plan;
  const uint64_t all = input_.backend.memory_bytes();
  if (all == 0) return;
  if (PredictSlabBytes(request, plan.grid, mesh, run.surface, plan.slab_depth) < all / kShareInDoubt) return;
  const std::optional<uint64_t> room = stages_.FreeBytes();
  if (!room) return;
  PlanLimits limits = input_.limits;
  limits.slab_depth = FittingSlabDepth(request, plan.grid, mesh, run.surface, plan.slab_depth, *room);
  if (limits.slab_depth == plan.slab_depth) return;
  const Footprint need = input_.backend.Predict(request, plan.grid, mesh, run.surface, limits, input_.delivery);
  plan.slab_depth = limits.slab_depth;
  plan.peak_bytes = need.peak_bytes;
  plan.list_bytes = need.list_bytes;
}

absl::Status RunPlanner::Explain(const Plan& plan, uint64_t refused_bytes) const {
  const uint64_t need = plan.peak_bytes + refused_bytes;
  return GridTooLarge(input_, plan.grid, false, need, double(need) / double(plan.peak_bytes));
}

}  // namespace voxelpipe
