// Items of a pass whose targets have values: host-side descriptions and their accumulators.
#pragma once

#include <cstdint>
#include <vector>

#include "cuda/batch/batch.h"
#include "cuda/batch/batch_member.h"
#include "cuda/coverage/accumulator_views.h"

namespace voxelpipe::cuda {

class BatchValues {
 public:
  // Adds item `number` and describes it in `item`. Items come in order and are adjacent. `targets`: those that are not
  // occupancy bits; At sets their memory.
  void Add(uint32_t number, const TargetViews& targets, BatchItemView& item);
  // The `index`-th added target; call before Make.
  CudaTarget& At(size_t index) { return targets_[index].target; }
  size_t targets() const { return targets_.size(); }

  // Runs all stages, from triangles to values and coverage. Synchronizes.
  absl::Status Make(BatchState& state);

 private:
  // Allocates accumulators for `touched` voxels per item.
  absl::Status Allocate(BatchState& state, const std::vector<uint32_t>& touched);

  uint32_t first_item_ = 0, items_ = 0;
  std::vector<ShadedTarget> targets_;
  std::vector<uint32_t> item_of_;  // per target
  DeviceArray<ShadedTarget> targets_there_;
  DeviceArray<uint32_t> item_of_there_, touched_;
  DeviceArray<uint8_t> accumulators_;
};

}  // namespace voxelpipe::cuda
