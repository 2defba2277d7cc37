// The faces of solid voxels that another solid voxel does not cover.
#pragma once

#include <array>
#include <bit>
#include <cstdint>

#include "absl/status/statusor.h"
#include "encode/drawn/whole_file.h"

namespace voxelpipe {

// The sides of a voxel, in the order -x, +x, -y, +y, -z, +z.
inline constexpr int kSides = 6;

// The four corners of a side, as offsets of 0 or 1, counter-clockwise seen from outside.
inline constexpr std::array<std::array<std::array<int, 3>, 4>, kSides> kSideCorners = {{
    {{{0, 0, 0}, {0, 0, 1}, {0, 1, 1}, {0, 1, 0}}},
    {{{1, 0, 0}, {1, 1, 0}, {1, 1, 1}, {1, 0, 1}}},
    {{{0, 0, 0}, {1, 0, 0}, {1, 0, 1}, {0, 0, 1}}},
    {{{0, 1, 0}, {0, 1, 1}, {1, 1, 1}, {1, 1, 0}}},
    {{{0, 0, 0}, {0, 1, 0}, {1, 1, 0}, {1, 0, 0}}},
    {{{0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}}},
}};

struct FaceCount {
  uint64_t faces = 0, voxels = 0;  // exposed faces, and the voxels that have some

  friend FaceCount operator+(const FaceCount& a, const FaceCount& b) {
    return {a.faces + b.faces, a.voxels + b.voxels};
  }
};

// `job` may be null. Errors: the job's.
absl::StatusOr<FaceCount> CountFaces(const PreviewVolume& volume, const JobContext* job);

// Calls visit(i, j, n, side) for the exposed faces of layer k, voxel after voxel in linear order. Errors: the job's.
template <typename Visit>
absl::Status VisitFaces(const PreviewVolume& volume, int64_t k, JobPoll& poll, const Visit& visit) {
  const int width = volume.word_voxels();
  return volume.VisitRows(k, poll, [&](int64_t i, int64_t j, uint32_t solid) {
    const std::array<uint32_t, kSides> covered = {volume.Row(i - 1, j, k, width), volume.Row(i + 1, j, k, width),
                                                  volume.Row(i, j - 1, k, width), volume.Row(i, j + 1, k, width),
                                                  volume.Row(i, j, k - 1, width), volume.Row(i, j, k + 1, width)};
    uint32_t all = ~0u;
    for (const uint32_t word : covered) all &= word;
    for (uint32_t word = solid & ~all; word != 0; word &= word - 1) {
      const int bit = std::countr_zero(word);
      for (int side = 0; side < kSides; ++side) {
        if (((covered[size_t(side)] >> bit) & 1) == 0) visit(i + bit, j, volume.Linear(i + bit, j, k), side);
      }
    }
  });
}

}  // namespace voxelpipe
