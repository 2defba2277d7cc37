// The solid voxels of a result, for drawings.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "job/job_work.h"
#include "job/result.h"

namespace voxelpipe {

// A bit a voxel, or, where that would be much more than the result itself, only the bricks of 8x8x8 voxels with solid
// ones. Borrows the bits of a dense result and the bricks of a sparse one, which must outlive it; its own memory is
// charged to the job's.
class PreviewVolume {
 public:
  // In: a result of any kind with at least one target; solid voxels are those of RenderPreview (png_preview.h). Errors:
  // INVALID_ARGUMENT for a result without targets or with arrays that do not fit; the job's; RESOURCE_EXHAUSTED.
  static absl::StatusOr<PreviewVolume> Build(const VoxelizeResult& result, const JobContext* job);
  // Two by two by two voxels as one, solid if one is. Borrows nothing.
  static absl::StatusOr<PreviewVolume> Halved(const PreviewVolume& fine, const JobContext* job);

  const std::array<int64_t, 3>& dims() const { return dims_; }

  // True if voxel (i,j,k) is solid; false outside the grid.
  bool Solid(int64_t i, int64_t j, int64_t k) const {
    if (i < 0 || j < 0 || k < 0 || i >= dims_[0] || j >= dims_[1] || k >= dims_[2]) return false;
    if (in_bricks_) return Row(i, j, k, 1) != 0;
    const uint64_t n = Linear(i, j, k);
    return (bits_[n / 8] >> (n % 8)) & 1;
  }
  // True if the neighbours of voxel n of the linear order are solid, up to six; where the grid ends it cuts a solid.
  bool Enclosed(uint64_t n) const {
    const int64_t i = int64_t(n) % dims_[0], j = int64_t(n) / dims_[0] % dims_[1], k = int64_t(n) / dims_[0] / dims_[1];
    return (i == 0 || Solid(i - 1, j, k)) && (i + 1 == dims_[0] || Solid(i + 1, j, k)) &&
           (j == 0 || Solid(i, j - 1, k)) && (j + 1 == dims_[1] || Solid(i, j + 1, k)) &&
           (k == 0 || Solid(i, j, k - 1)) && (k + 1 == dims_[2] || Solid(i, j, k + 1));
  }
  // Bits of the voxels i .. i+count-1 of a row, count <= 32, the lowest bit first; 0 outside the grid.
  uint32_t Row(int64_t i, int64_t j, int64_t k, int count) const;

  uint64_t Linear(int64_t i, int64_t j, int64_t k) const {
    return uint64_t(i) + uint64_t(dims_[0]) * (uint64_t(j) + uint64_t(dims_[1]) * uint64_t(k));
  }

  // The layers that may have solid voxels are Layer(0), ..., Layer(layers() - 1), ascending in z.
  int64_t layers() const { return layers_; }
  int64_t Layer(int64_t n) const { return in_bricks_ ? 8 * groups_[size_t(n / 8)].z + n % 8 : n; }
  // The first of them at or above layer k; layers() if there is none.
  int64_t FirstLayer(int64_t k) const;

  // Calls visit(i, j, word) for the rows' words of layer k that have solid voxels, in linear order: bit b is voxel
  // (i + b, j, k), b < word_voxels(). The job's end ends the walk with its error.
  template <typename Visit>
  absl::Status VisitRows(int64_t k, JobPoll& poll, const Visit& visit) const;
  int word_voxels() const { return in_bricks_ ? 8 : 32; }

  // Calls visit(x, y, z) with the indices of each brick of 8x8x8 voxels that has solid ones, in the order of a sparse
  // result.
  template <typename Visit>
  absl::Status VisitBricks(const JobContext* job, const Visit& visit) const;

  // True if only bricks are stored.
  bool in_bricks() const { return in_bricks_; }
  // The bits of all voxels, bit n of the linear order; empty if in_bricks().
  std::span<const uint8_t> bits() const { return bits_; }
  // The brick with these indices, a word for each z, or null if it is not stored. Only if in_bricks().
  const uint64_t* FindBrick(int64_t x, int64_t y, int64_t z) const {
    const auto found = places_.find(BrickId(x, y, z));
    return found == places_.end() ? nullptr : &masks_[8 * found->second];
  }

 private:
  // The bricks of eight layers.
  struct Group {
    int64_t z;       // of the bricks
    uint64_t first;  // of ids_
  };

  explicit PreviewVolume(const std::array<int64_t, 3>& dims, const JobContext* job);

  uint64_t BrickId(int64_t x, int64_t y, int64_t z) const {
    return uint64_t(x) + uint64_t(across_) * (uint64_t(y) + uint64_t(rows_) * uint64_t(z));
  }
  uint64_t bit_bytes() const;
  // True if a bit a voxel is no more than a result of so many bytes justifies.
  bool WantsBits(uint64_t listed_bytes) const;
  // All clear.
  absl::Status AllocateBits();
  // The index of ids_ and masks_.
  absl::Status IndexBricks(const JobContext* job);
  // In: each(set), which calls set(i, j, k) for all solid voxels and returns an error to end early. MakeBricks calls it
  // twice.
  template <typename Each>
  absl::Status MakeBits(const Each& each);
  template <typename Each>
  absl::Status MakeBricks(const JobContext* job, const Each& each);
  std::pair<size_t, size_t> BricksOfLayer(int64_t k) const;
  uint32_t RowOfBricks(int64_t i, int64_t j, int64_t k, int count) const;

  std::array<int64_t, 3> dims_;
  int64_t across_, rows_;  // bricks along x and y
  int64_t layers_ = 0;
  MemoryCharge memory_;
  std::span<const uint8_t> bits_;
  std::vector<uint8_t> own_bits_;

  bool in_bricks_ = false;
  std::span<const uint64_t> ids_, masks_;  // ascending; eight words a brick, byte y of word z has the bits along x
  std::vector<uint64_t> own_ids_, own_masks_;
  std::vector<Group> groups_;
  absl::flat_hash_map<uint64_t, uint64_t> places_;  // of ids in ids_
};

template <typename Visit>
absl::Status PreviewVolume::VisitRows(int64_t k, JobPoll& poll, const Visit& visit) const {
  if (!in_bricks_) {
    constexpr int64_t kSegment = 1 << 17;  // voxels between two looks at the job
    for (int64_t j = 0; j < dims_[1]; ++j) {
      for (int64_t begin = 0; begin < dims_[0]; begin += kSegment) {
        const int64_t end = std::min(dims_[0], begin + kSegment);
        uint64_t units = uint64_t(end - begin) / 32 + 1;
        for (int64_t i = begin; i < end; i += 32) {
          const uint32_t word = Row(i, j, k, 32);
          if (word == 0) continue;
          visit(i, j, word);
          units += uint64_t(std::popcount(word));
        }
        if (absl::Status s = poll.Add(units); !s.ok()) return s;
      }
    }
    return absl::OkStatus();
  }
  const auto [first, last] = BricksOfLayer(k);
  for (size_t begin = first, end = first; begin < last; begin = end) {
    const uint64_t row = ids_[begin] / uint64_t(across_), next_row = (row + 1) * uint64_t(across_);
    while (end < last && ids_[end] < next_row) ++end;
    const auto y = 8 * int64_t(row % uint64_t(rows_));
    for (int64_t j = y; j < std::min(y + 8, dims_[1]); ++j) {
      uint64_t units = end - begin;
      for (size_t b = begin; b < end; ++b) {
        uint32_t word = (masks_[8 * b + size_t(k % 8)] >> (8 * (j % 8))) & 255;
        if (word == 0) continue;
        const auto i = 8 * int64_t(ids_[b] - row * uint64_t(across_));
        if (i + 8 > dims_[0]) word &= (1u << (dims_[0] - i)) - 1;
        if (word == 0) continue;
        visit(i, j, word);
        units += uint64_t(std::popcount(word));
      }
      if (absl::Status s = poll.Add(units); !s.ok()) return s;
    }
  }
  return absl::OkStatus();
}

template <typename Visit>
absl::Status PreviewVolume::VisitBricks(const JobContext* job, const Visit& visit) const {
  JobPoll poll(job);
  const auto has_voxels = [&](uint32_t bits, int64_t i) {
    return i < dims_[0] && (bits & (i + 8 > dims_[0] ? (1u << (dims_[0] - i)) - 1 : 255)) != 0;
  };
  if (in_bricks_) {
    for (size_t b = 0; b < ids_.size(); ++b) {
      if (absl::Status s = poll.Add(1); !s.ok()) return s;
      const uint64_t row = ids_[b] / uint64_t(across_);
      const auto x = int64_t(ids_[b] % uint64_t(across_));
      const auto y = int64_t(row % uint64_t(rows_)), z = int64_t(row / uint64_t(rows_));
      uint32_t bits = 0;
      for (int64_t k = 0; k < std::min<int64_t>(8, dims_[2] - 8 * z); ++k) {
        for (int64_t j = 0; j < std::min<int64_t>(8, dims_[1] - 8 * y); ++j) {
          bits |= uint32_t((masks_[8 * b + size_t(k)] >> (8 * j)) & 255);
        }
      }
      if (has_voxels(bits, 8 * x)) visit(x, y, z);
    }
    return absl::OkStatus();
  }
  for (int64_t z = 0; 8 * z < dims_[2]; ++z) {
    for (int64_t y = 0; y < rows_; ++y) {
      for (int64_t x = 0; x < across_; x += 4) {
        uint32_t bits = 0;
        for (int64_t k = 8 * z; k < std::min(8 * z + 8, dims_[2]); ++k) {
          for (int64_t j = 8 * y; j < std::min(8 * y + 8, dims_[1]); ++j) bits |= Row(8 * x, j, k, 32);
        }
        for (int64_t b = x; bits != 0; ++b, bits >>= 8) {
          if ((bits & 255) != 0) visit(b, y, z);
        }
        if (absl::Status s = poll.Add(64); !s.ok()) return s;
      }
    }
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
