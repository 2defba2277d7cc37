// The scheduler's lanes: by the workers that may run a task, and by its size.
#pragma once

#include <cstddef>

#include "job/request.h"
#include "schedule/cost.h"
#include "schedule/fair_queue.h"

namespace voxelpipe {

// Tasks that any kind of worker may run are in the lanes of kAuto.
constexpr size_t LaneFor(BackendChoice kind, SizeClass size) {
  return size_t(kind) * kSizeClasses + size_t(size);
}
constexpr SizeClass SizeOfLane(size_t lane) {
  return SizeClass(lane % kSizeClasses);
}
constexpr FairQueue::Lanes LanesOfKind(BackendChoice kind) {
  return FairQueue::Lanes{7} << LaneFor(kind, SizeClass::kSmall);
}
constexpr FairQueue::Lanes LanesOfSize(SizeClass size) {
  return FairQueue::Lanes{1 | 1 << kSizeClasses | 1 << 2 * kSizeClasses} << size_t(size);
}
static_assert(size_t(BackendChoice::kCuda) == 2 && FairQueue::kLanes == 3 * kSizeClasses);

}  // namespace voxelpipe
