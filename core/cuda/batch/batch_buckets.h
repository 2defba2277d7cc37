// The A-buffers of a pass: host-side descriptions, and extraction of each item's result from the results of the pass.
#pragma once

#include <cstdint>
#include <vector>

#include "cuda/batch/batch.h"
#include "cuda/batch/batch_member.h"
#include "cuda/device/upload_layout.h"

namespace voxelpipe::cuda {

class BatchBuckets {
 public:
  // Adds a member and describes it in its item, number `number`. Members come in the order of their items.
  void Add(const BatchMember& member, uint32_t number, BatchItemView& item, BatchState& state);
  // Kernel descriptions of targets. Call Place when the layout's block has its address.
  void AddTo(UploadLayout& layout) { targets_at_ = layout.Add(targets_.data(), targets_.size()); }
  void Place(const uint8_t* block, BatchView& view) const {
    view.shaded = reinterpret_cast<const CudaTarget*>(block + targets_at_);
  }

  // Runs all stages of the A-buffers, up to results on the device. Synchronizes.
  absl::Status Make(BatchState& state);
  // After Make. `to` has result_bytes() bytes and is valid when the stream's work is done.
  uint64_t result_bytes() const { return result_bytes_; }
  absl::Status CopyBack(BatchState& state, uint8_t* to) const;
  // Extracts the arrays of the `number`-th added member from what CopyBack copied.
  absl::Status Cut(size_t number, const uint8_t* from, VoxelizeResult& result) const;

 private:
  struct Bucketed {
    const VoxelizeRequest* request = nullptr;
    uint32_t item = 0, first_target = 0;
    bool shades = false;  // otherwise its targets have a 1 for each fragment
    uint64_t first_voxel = 0, voxel_end = 0;
    uint64_t first_fragment = 0, fragments = 0;
  };

  absl::Status Shade(BatchState& state);

  std::vector<Bucketed> items_;
  std::vector<CudaTarget> targets_;  // targets that are shaded
  uint64_t targets_at_ = 0;
  std::vector<BatchFragmentRange> ranges_;
  DeviceArray<BatchFragmentRange> ranges_there_;
  DeviceArray<uint8_t*> values_there_;
  // Results on the device (voxels, offsets, values of targets), and their offsets and those of the triangles on the
  // host.
  DeviceArray<uint8_t> results_;
  uint64_t voxels_ = 0;  // listed voxels
  uint64_t offsets_at_ = 0, triangles_at_ = 0, result_bytes_ = 0;
  std::vector<uint64_t> values_at_;  // per element of targets_
};

}  // namespace voxelpipe::cuda
