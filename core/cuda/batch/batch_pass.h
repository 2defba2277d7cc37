// One pass of the device over the members of a batch.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include "cuda/batch/batch.h"
#include "cuda/batch/batch_buckets.h"
#include "cuda/batch/batch_member.h"
#include "cuda/batch/batch_mesh.h"
#include "cuda/batch/batch_values.h"
#include "cuda/device/pinned.h"
#include "cuda/device/upload_layout.h"

namespace voxelpipe::cuda {

class BatchPass {
 public:
  // `members` in the order of BatchMember::order(). What they point to must outlive the pass.
  BatchPass(const DeviceInfo& device, DeviceUse use, std::span<const std::unique_ptr<BatchMember>> members);
  ~BatchPass();

  // Runs all stages, up to results in host memory. Synchronizes.
  absl::Status Run();
  // True if the member has a result; after Run. There is none if a flood fill needs too many sweeps: the item must run
  // alone, where it can be cancelled.
  bool Finished(size_t number) const { return CountsOf(number).unfinished == 0; }
  // Extracts the result of a finished member, and moves its statistics; after Run. Thread-safe for different members.
  absl::StatusOr<VoxelizeResult> Cut(size_t number);

 private:
  // Additional state of a member with values. `bits` and `presence` are word offsets in own_bits_, `values` byte
  // offsets.
  struct Values {
    uint32_t first_value = 0, first_target = 0;  // in values_, in valued_
    TargetViews targets;
    std::array<uint64_t, kMaxTargets> bits{}, presence{}, values{};
  };
  // Where a member's results are in packed_, and its values.
  struct Place {
    uint32_t first_packed = 0;
    std::unique_ptr<Values> values;  // null for other paths
  };

  BatchCounts CountsOf(size_t number) const;
  void Describe();
  void DescribeItem(const BatchMember& member);
  void DescribeTargets(const BatchMember& member);
  void AddPacked(const BatchMember& member, bool clear, bool fill);
  void AddValues(const BatchMember& member);
  absl::Status Allocate();
  // Uploads descriptions and meshes in one copy.
  absl::Status Upload();
  void PointAtTargets(size_t number);
  // Extracts the arrays of a member that has a grid.
  absl::Status CutGrid(const BatchMember& member, const Place& place, VoxelizeResult& result) const;

  std::span<const std::unique_ptr<BatchMember>> members_;
  DeviceUse use_;  // destroyed after all arrays, which are freed on its stream
  BatchState state_;
  std::vector<BatchItemView> items_;
  std::vector<BatchTargetView> packed_;
  std::vector<BatchValueView> values_;
  std::vector<Place> places_;      // per member
  std::vector<BatchMesh> meshes_;  // per member
  BatchValues valued_;
  BatchBuckets buckets_;
  uint64_t words_ = 0, own_words_ = 0, shell_words_ = 0, columns_ = 0, value_bytes_ = 0;
  uint32_t* own_bits_ = nullptr;                                                        // bit grids of single targets
  uint8_t* first_values_ = nullptr;                                                     // on the device
  uint64_t packed_offset_ = 0, values_offset_ = 0, result_bytes_ = 0, buckets_at_ = 0;  // offsets in back_
  PinnedBuffer staging_, back_;
  KeptArrays kept_;
  DeviceArray<uint8_t> there_, work_;
};

}  // namespace voxelpipe::cuda
