// Bytes of the parts of a scene, computed from sizes.
#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "mesh/scene/animation.h"

namespace voxelpipe {

// Bytes of the error of a part of the file that cannot be used; 0 for usable parts.
uint64_t FaultBytes(const absl::Status& fault);
// With its samplers and channels.
uint64_t AnimationBytes(const Animation& animation);

}  // namespace voxelpipe
