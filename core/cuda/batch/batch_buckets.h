// The A-buffers of a pass: what the host knows of them between the steps, and how their results are cut out of the
// pass's.
#pragma once

#include <cstdint>
#include <vector>

#include "cuda/batch/batch.h"
#include "cuda/batch/batch_member.h"
#include "cuda/device/upload_layout.h"

namespace voxelpipe::cuda {

class BatchBuckets {
 public:
  // Describes a member: in its item, number `number`, and for all. Members come in the order of their items.
  void Add(const BatchMember& member, uint32_t number, BatchItemView& item, BatchState& state);
  // What kernels get of targets. Place: once the layout's block has its place.
  void AddTo(UploadLayout& layout) { targets_at_ = layout.Add(targets_.data(), targets_.size()); }
  void Place(const uint8_t* block, BatchView& view) const {
    view.shaded = reinterpret_cast<const CudaTarget*>(block + targets_at_);
  }

  // All their stages, up to results on the device. Synchronizes.
  absl::Status Make(BatchState& state);
  // After Make. `to` has room for result_bytes(); it is filled when the stream's work is done.
  uint64_t result_bytes() const { return result_bytes_; }
  absl::Status CopyBack(BatchState& state, uint8_t* to) const;
  // The arrays of member number `number` among those that were added, out of what CopyBack brought.
  absl::Status Cut(size_t number, const uint8_t* from, VoxelizeResult& result) const;

 private:
  struct Bucketed {
    const VoxelizeRequest* request = nullptr;
    uint32_t item = 0, first_target = 0;
    bool shades = false;  // else its targets have a 1 for each fragment
    uint64_t first_voxel = 0, voxel_end = 0;
    uint64_t first_fragment = 0, fragments = 0;
  };

  absl::Status Shade(BatchState& state);

  std::vector<Bucketed> items_;
  std::vector<CudaTarget> targets_;  // of those that are shaded
  uint64_t targets_at_ = 0;
  std::vector<BatchFragmentRange> ranges_;
  DeviceArray<BatchFragmentRange> ranges_there_;
  DeviceArray<uint8_t*> values_there_;
  // Results on the device, voxels, offsets and values of targets; and where they and the triangles come to lie on the
  // host.
  DeviceArray<uint8_t> results_;
  uint64_t voxels_ = 0;  // listed ones
  uint64_t offsets_at_ = 0, triangles_at_ = 0, result_bytes_ = 0;
  std::vector<uint64_t> values_at_;  // of targets_
};

}  // namespace voxelpipe::cuda
