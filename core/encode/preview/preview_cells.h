// The solid voxels before a camera: what a ray meets, coarse cells to skip empty space, densities for soft light.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/vec.h"
#include "encode/preview/preview_volume.h"

namespace voxelpipe {

// The point where a ray enters the first solid voxel.
struct PreviewHit {
  bool hit = false;
  std::array<int64_t, 3> voxel{};
  int axis = 0;  // of the face that the ray enters through
  double t = 0;  // along the ray
};

// Positions are in index space. Borrows the volume, which must outlive it. Its memory is charged to the job's.
class PreviewCells {
 public:
  static absl::StatusOr<PreviewCells> Build(const PreviewVolume& volume, const JobContext* job);

  const PreviewVolume& volume() const { return volume_; }
  bool empty() const { return lo_[0] >= hi_[0]; }
  // Box of the solid voxels, [lo, hi); meaningless if empty().
  const std::array<int64_t, 3>& lo() const { return lo_; }
  const std::array<int64_t, 3>& hi() const { return hi_; }

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

  PreviewCells(const PreviewVolume& volume, const JobContext* job) : volume_(volume), memory_(&MemoryOf(job)) {}

  absl::Status CountCells(const JobContext* job);
  absl::Status BuildDistances(const JobContext* job);
  void BuildLevels();
  template <bool kInBricks>
  PreviewHit TraceIn(const Vec3d& origin, const Vec3d& direction, double t_min, double t_max) const;

  const PreviewVolume& volume_;
  MemoryCharge memory_;
  std::array<int64_t, 3> lo_{}, hi_{};
  int64_t cell_ = 1;    // voxels a side of a cell of level 0, a power of two
  int cell_shift_ = 0;  // its logarithm
  std::vector<Level> levels_;
  std::vector<uint8_t>
      distance_;  // per cell of level 0: Chebyshev distance to the nearest cell with solid voxels, 0 = itself
};

}  // namespace voxelpipe
