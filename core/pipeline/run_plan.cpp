#include "pipeline/run_plan.h"

#include <utility>

#include "pipeline/plan/footprint.h"

namespace voxelpipe {

absl::StatusOr<PlannedRun> RunPlanner::Make() const {
  absl::StatusOr<PlannedRun> run = PlanOn(input_);
  if (run.ok()) FitToDevice(*run);
  return run;
}

void RunPlanner::FitToDevice(PlannedRun& run) const {
  const VoxelizeRequest& request = input_.request;
  Plan& plan = run.plan;
  PlanLimits limits = input_.limits;
  limits.slab_depth = stages_.FittingSlabDepth(plan.grid, input_.mesh, run.surface, plan.slab_depth);
  if (limits.slab_depth == plan.slab_depth) return;
  const Footprint need = input_.backend.Predict(request, plan.grid, input_.mesh, run.surface, limits, input_.delivery);
  plan.slab_depth = limits.slab_depth;
  plan.peak_bytes = need.peak_bytes;
  plan.list_bytes = need.list_bytes;
}

absl::Status RunPlanner::Explain(const Plan& plan, const Surface& surface, uint64_t refused_bytes) const {
  const uint64_t need = plan.peak_bytes + refused_bytes;
  return GridTooLarge(input_, plan.grid, &surface, false, need, double(need) / double(plan.peak_bytes));
}

}  // namespace voxelpipe
