// One pass of the device for the members of a batch.
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
  // In the order of BatchMember::order(). What is pointed to must outlive the pass.
  BatchPass(const DeviceInfo& device, DeviceUse use, std::span<const std::unique_ptr<BatchMember>> members);
  ~BatchPass();

  // All stages, up to the results in host memory. Synchronizes.
  absl::Status Run();
  // Whether there is a result of a member; after Run. There is none of a flood whose walk is a long one: it goes alone,
  // where it can be cancelled.
  bool Finished(size_t number) const { return CountsOf(number).unfinished == 0; }
  // The result of a member that is finished; after Run. Takes its statistics. Members may be cut at the same time.
  absl::StatusOr<VoxelizeResult> Cut(size_t number);

 private:
  // What a member whose targets have values has besides. Bit grids are words from the first one of `own bits`, values
  // bytes from the first one.
  struct Values {
    uint32_t first_value = 0, first_target = 0;  // of values_, of valued_
    TargetViews targets;
    std::array<uint64_t, kMaxTargets> bits{}, presence{}, values{};
  };
  // Where a member's results are among packed_, and the rest.
  struct Place {
    uint32_t first_packed = 0;
    std::unique_ptr<Values> values;  // null: its path is another
  };

  BatchCounts CountsOf(size_t number) const;
  void Describe();
  void DescribeItem(const BatchMember& member);
  void DescribeTargets(const BatchMember& member);
  void AddPacked(const BatchMember& member, bool clear, bool fill);
  void AddValues(const BatchMember& member);
  absl::Status Allocate();
  // Descriptions and meshes go up in one copy.
  absl::Status Upload();
  void PointAtTargets(size_t number);
  // The arrays of a member that has a grid.
  absl::Status CutGrid(const BatchMember& member, const Place& place, VoxelizeResult& result) const;

  std::span<const std::unique_ptr<BatchMember>> members_;
  DeviceUse use_;  // destroyed behind all arrays, which are freed on its stream
  BatchState state_;
  std::vector<BatchItemView> items_;
  std::vector<BatchTargetView> packed_;
  std::vector<BatchValueView> values_;
  std::vector<Place> places_;      // per member
  std::vector<BatchMesh> meshes_;  // likewise
  BatchValues valued_;
  BatchBuckets buckets_;
  uint64_t words_ = 0, own_words_ = 0, shell_words_ = 0, columns_ = 0, value_bytes_ = 0;
  uint32_t* own_bits_ = nullptr;                                                        // bit grids of single targets
  uint8_t* first_values_ = nullptr;                                                     // on the device
  uint64_t packed_offset_ = 0, values_offset_ = 0, result_bytes_ = 0, buckets_at_ = 0;  // in back_
  PinnedBuffer staging_, back_;
  KeptArrays kept_;
  DeviceArray<uint8_t> there_, work_;
};

}  // namespace voxelpipe::cuda
