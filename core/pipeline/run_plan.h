// The plan of one run, whose vertices are shaded.
#pragma once

#include <algorithm>
#include <cstdint>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "pipeline/plan/plan.h"
#include "pipeline/planner.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe {

class RunPlanner {
 public:
  // `stages` have shaded the mesh's vertices; `mesh` has the extent that they gave. All that is given outlives this.
  RunPlanner(const Backend& backend, const Stages& stages, const VoxelizeRequest& request, const MeshSize& mesh,
             const PlanLimits& limits, Delivery delivery)
      : stages_(stages), input_{backend,
                                request,
                                mesh,
                                [&stages, &mesh](const GridSpec& grid, bool closely) {
                                  return stages.Measure(grid, mesh, closely);
                                },
                                limits,
                                delivery} {}

  // PlanOn (planner.h), its slabs thinned until they fit the device.
  absl::StatusOr<PlannedRun> Make() const;
  // Bytes that the limits allow beyond the plan.
  uint64_t RoomBeyond(const Plan& plan) const {
    return input_.limits.max_working_bytes - std::min(input_.limits.max_working_bytes, plan.peak_bytes);
  }
  // RESOURCE_EXHAUSTED for a run that came to need `refused_bytes` more than its plan: says what would fit. `surface`:
  // that of the plan.
  absl::Status Explain(const Plan& plan, const Surface& surface, uint64_t refused_bytes) const;

 private:
  void FitToDevice(PlannedRun& run) const;

  const Stages& stages_;
  const PlanInput input_;
};

}  // namespace voxelpipe
