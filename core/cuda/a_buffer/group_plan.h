// Whether and how an A-buffer's fragments are bundled (fragment_group.h). It is a matter of speed alone.
#pragma once

#include <optional>

#include "cuda/run/fragment_group.h"
#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

// None where fragments are wanted by themselves before the end, or neighbouring triangles have few voxels in common: in
// meshes in no order, or of large triangles. Nor where the cache holds the mesh's fragments.
std::optional<BundlePlan> PlanBundles(RunState& state);

}  // namespace voxelpipe::cuda
