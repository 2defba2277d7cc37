// Decides whether and how an A-buffer's fragments are grouped (fragment_group.h). Affects speed only.
#pragma once

#include <optional>

#include "cuda/run/fragment_group.h"
#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

// nullopt if fragments are shaded or may be discarded, if neighbouring triangles share few voxels (unordered meshes,
// large triangles), or if the L2 cache holds all fragments.
std::optional<BundlePlan> PlanBundles(RunState& state);

}  // namespace voxelpipe::cuda
