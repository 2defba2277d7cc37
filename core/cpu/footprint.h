// The memory that a run takes on the CPU, predicted.
#pragma once

#include "pipeline/plan/footprint.h"
#include "pipeline/plan/plan.h"
#include "pipeline/plan/surface.h"

namespace voxelpipe::cpu {

// Backend::Predict (pipeline/stages/stages.h): all of it is the host's. tests/property/plan_bounds.cpp compares it with
// what allocators count.
Footprint PredictFootprint(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                           const Surface& surface, const PlanLimits& limits, Delivery delivery);

}  // namespace voxelpipe::cpu
