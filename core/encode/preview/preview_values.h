// The values of a result's targets by voxel, for every kind of result.
#pragma once

#include <cstdint>
#include <cstring>
#include <vector>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "job/result.h"
#include "shaders/blend_ops.h"

namespace voxelpipe {

// Checks that the arrays of `result` are consistent: sizes as in HeaderOf; bricks, voxels and offsets ascending and in
// range. The functions below rely on it. `job` may be null. INVALID_ARGUMENT naming the array; the job's error.
absl::Status CheckArrays(const VoxelizeResult& result, const JobContext* job);

// Finds the item of a target's array that belongs to a voxel. Borrows the result.
class PreviewItems {
 public:
  static constexpr uint64_t kNone = ~uint64_t{0};

  explicit PreviewItems(const VoxelizeResult& result);
  // What the constructor allocates.
  static uint64_t MemoryBytes(const VoxelizeResult& result);

  // In: voxel n of the linear order. Out: dense n itself; sparse: the rank of the voxel among the listed ones; buckets:
  // its last fragment, that of the largest triangle id, as blend `replace` would choose. kNone for a voxel that is not
  // listed.
  uint64_t Find(uint64_t n) const;
  // Fragments of voxel n of a bucketed result; 0 if it is not listed.
  uint64_t FragmentsOf(uint64_t n) const;
  // The most fragments that a voxel of a bucketed result has.
  uint64_t MaxFragments() const;
  // Items of the arrays.
  uint64_t count() const { return count_; }

 private:
  // The place of voxel n in the list of a bucketed result, kNone if it has none.
  uint64_t PlaceOf(uint64_t n) const;

  const VoxelizeResult& result_;
  uint64_t count_ = 0;
  std::vector<uint64_t> before_;  // sparse: voxels listed before those of a brick
};

// Reads the components of a target's items as floats. Not for kBit. Borrows the result.
class TargetValues {
 public:
  TargetValues() = default;
  TargetValues(const VoxelizeResult& result, size_t target, uint64_t items);

  float At(uint64_t item, int component) const {
    const uint64_t at = item * item_stride_ + uint64_t(component) * component_stride_;
    switch (format_) {
      case VoxelFormat::kU8: return float(data_[at]);
      case VoxelFormat::kU16: return float(Load<uint16_t>(at));
      case VoxelFormat::kU32: return float(Load<uint32_t>(at));
      case VoxelFormat::kF16: return FromHalf(Load<uint16_t>(at));
      default: return Load<float>(at);
    }
  }

  // The exact value of a kU32 target.
  uint32_t WordAt(uint64_t item, int component) const {
    return Load<uint32_t>(item * item_stride_ + uint64_t(component) * component_stride_);
  }

 private:
  template <typename T>
  T Load(uint64_t at) const {
    T value;
    std::memcpy(&value, data_ + at * sizeof(T), sizeof(T));
    return value;
  }

  const uint8_t* data_ = nullptr;
  VoxelFormat format_ = VoxelFormat::kF32;
  uint64_t item_stride_ = 1, component_stride_ = 1;  // elements
};

}  // namespace voxelpipe
