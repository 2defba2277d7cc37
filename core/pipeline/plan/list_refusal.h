// What ListMemory says of a run that needs more than its plan's limits allow: for who can say what would fit.
#pragma once

#include "absl/status/status.h"

namespace voxelpipe {

// RESOURCE_EXHAUSTED, marked.
absl::Status RefuseBeyondPlan();
bool IsRefusedBeyondPlan(const absl::Status& status);

}  // namespace voxelpipe
