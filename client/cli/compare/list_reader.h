// The voxels of a sparse or bucketed result, from front to back.
#pragma once

#include <array>
#include <cstdint>

#include "encode/read/stored_result.h"

namespace voxelpipe::cli {

// Keeps nothing but the current voxel. The lists are checked while they are read.
class ListReader {
 public:
  // `result` must outlive the object.
  explicit ListReader(const StoredResult& result);

  // Goes to the next voxel, or to the end. Errors: INVALID_ARGUMENT for a voxel outside the grid or not behind the last
  // one, and for offsets that do not ascend from 0 to the number of fragments; those of ArrayReader.
  absl::Status Next();

  bool ended() const { return key_ == kEnd; }
  // Ascends from voxel to voxel, in the order of the result: bricks and their voxels, or linear indices.
  uint64_t key() const { return key_; }
  const std::array<int64_t, 3>& ijk() const { return ijk_; }
  // Of the current voxel; 1 in a sparse result.
  uint64_t fragments() const { return fragments_; }
  // The triangle of the voxel's next fragment; always 0 in a sparse result.
  absl::Status NextTriangle(int64_t& triangle);

 private:
  static constexpr uint64_t kEnd = UINT64_MAX;

  uint64_t KeyOf(const std::array<int64_t, 3>& ijk) const;

  const StoredResult& result_;
  ArrayReader ijk_reader_, offsets_, triangles_;
  uint64_t next_ = 0;  // voxels read
  uint64_t key_ = 0;
  std::array<int64_t, 3> ijk_{};
  int64_t end_ = 0;  // of the current voxel's fragments
  uint64_t fragments_ = 0;
  uint64_t triangles_read_ = 0;  // of the current voxel
};

}  // namespace voxelpipe::cli
