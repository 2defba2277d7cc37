// A result as the preview draws it: solid voxels, coarse cells to skip empty space, densities for soft light.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "base/vec.h"
#include "job/result.h"

namespace voxelpipe {

// The point where a ray enters the first solid voxel.
struct PreviewHit {
  bool hit = false;
  std::array<int64_t, 3> voxel{};
  int axis = 0;  // of the face that the ray enters through
  double t = 0;  // along the ray
};

// Positions are in index space. Borrows the bits of a dense result that has a bit target; the result must outlive it.
class PreviewVolume {
 public:
  static absl::StatusOr<PreviewVolume> Build(const VoxelizeResult& result, const JobContext* job);

  const std::array<int64_t, 3>& dims() const { return dims_; }
  bool empty() const { return lo_[0] >= hi_[0]; }
  // Box of the solid voxels, [lo, hi); meaningless if empty().
  const std::array<int64_t, 3>& lo() const { return lo_; }
  const std::array<int64_t, 3>& hi() const { return hi_; }

  // True if voxel (i,j,k) is solid; false outside the grid.
  bool Solid(int64_t i, int64_t j, int64_t k) const {
    if (i < 0 || j < 0 || k < 0 || i >= dims_[0] || j >= dims_[1] || k >= dims_[2]) return false;
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

  // Calls visit(low, high) with the box in index space of every coarse cell with solid voxels.
  template <typename Visit>
  void VisitCells(const Visit& visit) const {
    const Level& base = levels_[0];
    for (size_t n = 0; n < base.density.size(); ++n) {
      if (base.density[n] == 0) continue;
      const std::array<int64_t, 3> cell{int64_t(n) % base.dims[0], int64_t(n) / base.dims[0] % base.dims[1],
                                        int64_t(n) / base.dims[0] / base.dims[1]};
      Vec3d low, high;
      for (int a = 0; a < 3; ++a) {
        low[a] = double(std::max(lo_[size_t(a)], cell[size_t(a)] * cell_));
        high[a] = double(std::min(hi_[size_t(a)], (cell[size_t(a)] + 1) * cell_));
      }
      visit(low, high);
    }
  }

  // The first solid voxel on origin + t * direction with t in [t_min, t_max].
  PreviewHit Trace(const Vec3d& origin, const Vec3d& direction, double t_min, double t_max) const;

  // Share of solid voxels around p, in [0, 1], interpolated between cells of CellSize(level) voxels.
  float Density(int level, const Vec3d& p) const;
  int levels() const { return int(levels_.size()); }
  double CellSize(int level) const { return double(cell_ << level); }

 private:
  struct Level {
    std::array<int64_t, 3> dims{};
    std::vector<uint8_t> density;  // 255 = all solid; at least 1 if any voxel is
  };

  absl::Status CountCells(const JobContext* job);
  void BuildDistances();
  void BuildLevels();

  std::array<int64_t, 3> dims_{}, lo_{}, hi_{};
  std::span<const uint8_t> bits_;
  std::vector<uint8_t> own_bits_;  // if the result has no dense bit target
  int64_t cell_ = 1;               // voxels a side of a cell of level 0, a power of two
  int cell_shift_ = 0;             // its logarithm
  std::vector<Level> levels_;
  std::vector<uint8_t>
      distance_;  // per cell of level 0: Chebyshev distance to the nearest cell with solid voxels, 0 = itself
};

}  // namespace voxelpipe
