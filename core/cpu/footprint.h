// Predicts the memory of a run on the CPU.
#pragma once

#include "pipeline/plan/footprint.h"
#include "pipeline/plan/plan.h"
#include "pipeline/plan/surface.h"

namespace voxelpipe::cpu {

// Backend::Predict (pipeline/stages/stages.h): all of it is host memory. tests/property/plan_bounds.cpp compares it
// with the counts of the allocators.
Footprint PredictFootprint(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                           const Surface& surface, const PlanLimits& limits, Delivery delivery);

}  // namespace voxelpipe::cpu
