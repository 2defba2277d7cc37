// Parts of measure.cpp: the voxels of a triangle's box, and the bits of the grid's bricks.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>

#include "base/vec.h"
#include "grid/grid_spec.h"
#include "grid/index_space.h"
#include "mesh/views/mesh_view.h"
#include "raster/spans.h"
#include "raster/triangle_setup.h"

namespace voxelpipe {

inline constexpr double kTie = kNarrowWidening;  // voxels: the widening of coverage is at most this
inline constexpr double kReach = 0x1p40;         // voxels: a run refuses vertices beyond
inline constexpr int64_t kMaxCells = 1 << 24;    // 2 MiB of bits

using Box = std::array<std::pair<int64_t, int64_t>, 3>;  // first and last, inclusive

struct Triangle {
  Vec3d a, b, c;  // index space
};

inline Triangle TriangleAt(const MeshView& mesh, const IndexSpace& space, uint64_t t) {
  const uint32_t* const v = mesh.triangles[t];
  const auto place = [&](uint32_t i) { return WorldToIndex(space, mesh.positions[i]); };
  return {place(v[0]), place(v[1]), place(v[2])};
}

inline std::pair<Vec3d, Vec3d> BoundsOf(const Triangle& t) {
  Vec3d lo, hi;
  for (int i = 0; i < 3; ++i) {
    lo[i] = Min(t.a[i], Min(t.b[i], t.c[i]));
    hi[i] = Max(t.a[i], Max(t.b[i], t.c[i]));
  }
  return {lo, hi};
}

// A number from an irregular sequence: meshes made from grids correlate with regular ones.
inline uint64_t Scatter(uint64_t i) {
  i *= 0x9E3779B97F4A7C15ull;
  return (i ^ i >> 29) * 0xBF58476D1CE4E5B9ull >> 20;
}

inline bool IsWithinReach(const Vec3d& lo, const Vec3d& hi) {
  bool within = true;
  for (int i = 0; i < 3; ++i) within = within && lo[i] >= -kReach && hi[i] <= kReach;  // not where one is NaN
  return within;
}

// The voxels that the closed box touches, clipped to the grid; false if none, or if the box is beyond the coordinates
// that a run accepts.
inline bool VoxelsOf(const Vec3d& lo, const Vec3d& hi, const GridSpec& grid, Box& out) {
  if (!IsWithinReach(lo, hi)) return false;
  for (size_t i = 0; i < 3; ++i) {
    const double dim = double(grid.dims[i]);
    const double first = std::max(0.0, std::ceil(lo[int(i)] - kTie) - 1);
    const double last = std::min(dim - 1, std::floor(hi[int(i)] + kTie));
    if (!(first <= last)) return false;
    out[i] = {int64_t(first), int64_t(last)};
  }
  return true;
}

inline double Count(const Box& box) {
  double count = 1;
  for (const auto& [first, last] : box) count *= double(last - first + 1);
  return count;
}

inline VoxelRange RangeOf(const Box& box) {
  VoxelRange range;
  for (size_t i = 0; i < 3; ++i) {
    range.begin[i] = box[i].first;
    range.end[i] = box[i].second + 1;
  }
  return range;
}

// The layers of Surface::share_layers: shares are few.
inline int64_t LayersOfShare(const GridSpec& grid) {
  constexpr int64_t kMaxShares = 256;
  int64_t layers = 8;
  while ((grid.dims[2] + layers - 1) / layers > kMaxShares) layers *= 2;
  return layers;
}

// Bits of the cells of the grid: bricks, or larger ones in grids of very many bricks.
class Cells {
 public:
  explicit Cells(const GridSpec& grid) : grid_(grid) {
    const auto count = [&] {
      int64_t cells = 1;
      for (size_t i = 0; i < 3; ++i) cells *= dims_[i] = (grid.dims[i] + edge_ - 1) / edge_;
      return cells;
    };
    while ((count_ = count()) > kMaxCells) edge_ *= 2;
    bits_ = std::make_unique<std::atomic<uint64_t>[]>(size_t((count_ + 63) / 64));
  }

  int64_t edge() const { return edge_; }
  int64_t count() const { return count_; }
  int64_t dim(int axis) const { return dims_[axis]; }
  bool at(int64_t cell) const { return bits_[size_t(cell / 64)].load(std::memory_order_relaxed) >> (cell % 64) & 1; }
  uint64_t word(int64_t i) const { return bits_[size_t(i)].load(std::memory_order_relaxed); }
  int64_t words() const { return (count_ + 63) / 64; }

  void Mark(int64_t x, int64_t y, int64_t z) {
    const int64_t cell = x + dims_[0] * (y + dims_[1] * z);
    const uint64_t bit = uint64_t{1} << (cell % 64);
    std::atomic<uint64_t>& word = bits_[size_t(cell / 64)];
    if ((word.load(std::memory_order_relaxed) & bit) == 0) word.fetch_or(bit, std::memory_order_relaxed);
  }

  Box CellsOf(const Box& voxels) const {
    Box out;
    for (size_t i = 0; i < 3; ++i) out[i] = {voxels[i].first / edge_, voxels[i].second / edge_};
    return out;
  }
  // Calls visit(x, y, z) for each cell that the triangle may touch.
  template <typename Visit>
  void ForEach(const Triangle& t, const Box& voxels, const Visit& visit) const {
    const Box box = CellsOf(voxels);
    if (Count(box) <= 8) {
      for (int64_t z = box[2].first; z <= box[2].second; ++z) {
        for (int64_t y = box[1].first; y <= box[1].second; ++y) {
          for (int64_t x = box[0].first; x <= box[0].second; ++x) visit(x, y, z);
        }
      }
      return;
    }
    const double shrink = 1.0 / double(edge_);
    const auto setup = SetUpTriangle(t.a * shrink, t.b * shrink, t.c * shrink, Coverage::kConservative);
    ForEachRowSpan(setup, RangeOf(box), [&](int64_t y, int64_t z, int64_t x_begin, int64_t x_end) {
      for (int64_t x = x_begin; x < x_end; ++x) visit(x, y, z);
    });
  }
  // The voxels of a cell, clipped to the grid.
  Box VoxelsOfCell(int64_t cell) const {
    const int64_t at[3] = {cell % dims_[0], cell / dims_[0] % dims_[1], cell / dims_[0] / dims_[1]};
    Box out;
    for (size_t i = 0; i < 3; ++i) out[i] = {at[i] * edge_, std::min(grid_.dims[i], (at[i] + 1) * edge_) - 1};
    return out;
  }

 private:
  const GridSpec& grid_;
  int64_t edge_ = 8, count_ = 0;
  int64_t dims_[3] = {1, 1, 1};
  std::unique_ptr<std::atomic<uint64_t>[]> bits_;
};

// A larger cell holds bricks in proportion to the square of its edge, because a surface crosses it.
inline double BricksOfCell(const Cells& cells) {
  return std::pow(double(cells.edge()) / 8, 2) * (cells.edge() > 8 ? 1.3 : 1);
}

}  // namespace voxelpipe
