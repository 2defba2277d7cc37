// Bytes of the parts of a scene, computed from sizes.
#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "mesh/scene/animation.h"

namespace voxelpipe {

// What is kept of a part of the file that cannot be used; 0 for one that can.
uint64_t FaultBytes(const absl::Status& fault);
// With its samplers and channels.
uint64_t AnimationBytes(const Animation& animation);

}  // namespace voxelpipe
