// The faces of solid voxels that another solid voxel does not cover.
#pragma once

#include <array>
#include <cstdint>

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

// Number of exposed faces.
uint64_t CountFaces(const PreviewVolume& volume);

// Calls visit(i, j, n, side) for the exposed faces of layer k, voxel after voxel in linear order.
template <typename Visit>
void VisitFaces(const PreviewVolume& volume, int64_t k, const Visit& visit) {
  const auto& dims = volume.dims();
  for (int64_t j = 0; j < dims[1]; ++j) {
    for (int64_t i = 0; i < dims[0]; i += 32) {
      const uint32_t solid = volume.Row(i, j, k, 32);
      if (solid == 0) continue;
      const std::array<uint32_t, kSides> covered = {volume.Row(i - 1, j, k, 32), volume.Row(i + 1, j, k, 32),
                                                    volume.Row(i, j - 1, k, 32), volume.Row(i, j + 1, k, 32),
                                                    volume.Row(i, j, k - 1, 32), volume.Row(i, j, k + 1, 32)};
      uint32_t all = ~0u;
      for (const uint32_t word : covered) all &= word;
      for (uint32_t word = solid & ~all; word != 0; word &= word - 1) {
        const int bit = __builtin_ctz(word);
        for (int side = 0; side < kSides; ++side) {
          if (((covered[size_t(side)] >> bit) & 1) == 0) visit(i + bit, j, volume.Linear(i + bit, j, k), side);
        }
      }
    }
  }
}

}  // namespace voxelpipe
