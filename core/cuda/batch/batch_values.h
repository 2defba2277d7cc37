// The items of a pass whose targets have values: what the host holds of them, and their accumulators.
#pragma once

#include <cstdint>
#include <vector>

#include "cuda/batch/batch.h"
#include "cuda/batch/batch_member.h"
#include "cuda/coverage/accumulator_views.h"

namespace voxelpipe::cuda {

class BatchValues {
 public:
  // Describes item number `number`: in `item`, and for all. Items come in their order, next to one another. Its targets
  // but those that are the occupancy bit are `targets`, whose memory is told by At.
  void Add(uint32_t number, const TargetViews& targets, BatchItemView& item);
  // Target number `index` of those that were added, before Make.
  CudaTarget& At(size_t index) { return targets_[index].target; }
  size_t targets() const { return targets_.size(); }

  // All their stages, from triangles to values and coverage. Synchronizes.
  absl::Status Make(BatchState& state);

 private:
  // Room for the accumulators of targets whose items have so many touched voxels.
  absl::Status Allocate(BatchState& state, const std::vector<uint32_t>& touched);

  uint32_t first_item_ = 0, items_ = 0;
  std::vector<ShadedTarget> targets_;
  std::vector<uint32_t> item_of_;  // per target
  DeviceArray<ShadedTarget> targets_there_;
  DeviceArray<uint32_t> item_of_there_, touched_;
  DeviceArray<uint8_t> accumulators_;
};

}  // namespace voxelpipe::cuda
