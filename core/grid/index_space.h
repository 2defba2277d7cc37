// From world space to index space, where coverage is decided.
#pragma once

#include "base/vec.h"

namespace voxelpipe {

// In: a grid's origin and voxel size, a point in world units. Out: the point in voxels from the grid's first corner,
// without walls (IndexSpace).
VOXELPIPE_HD Vec3d WorldToIndex(const Vec3d& origin, const Vec3d& voxel_size, const Vec3d& p) {
  return {(p.x - origin.x) / voxel_size.x, (p.y - origin.y) / voxel_size.y, (p.z - origin.z) / voxel_size.z};
}

// The index space of a grid. Positions are float32: rounding may put the far side of a mesh that is a whole number of
// voxels long beyond the last voxel. A fitted grid therefore has a wall on each such axis (FitGrid): coordinates in
// (wall, wall_end] are moved to the wall.
struct IndexSpace {
  static constexpr double kNoWall = 0x1p1000;
  Vec3d origin{}, voxel_size{1, 1, 1};
  Vec3d wall{kNoWall, kNoWall, kNoWall}, wall_end{kNoWall, kNoWall, kNoWall};  // voxels from the first corner

  VOXELPIPE_HD bool has_walls() const { return wall.x < kNoWall || wall.y < kNoWall || wall.z < kNoWall; }
};

VOXELPIPE_HD double ToWall(double at, double wall, double wall_end) {
  return at > wall && at <= wall_end ? wall : at;
}

VOXELPIPE_HD Vec3d ToWalls(const IndexSpace& space, const Vec3d& at) {
  return {ToWall(at.x, space.wall.x, space.wall_end.x), ToWall(at.y, space.wall.y, space.wall_end.y),
          ToWall(at.z, space.wall.z, space.wall_end.z)};
}

VOXELPIPE_HD Vec3d WorldToIndex(const IndexSpace& space, const Vec3d& p) {
  return ToWalls(space, WorldToIndex(space.origin, space.voxel_size, p));
}

// The largest distance by which a wall moves a vertex, in voxels; 0 without walls.
inline double FarthestToWall(const IndexSpace& space) {
  double farthest = 0;
  for (int a = 0; a < 3; ++a) {
    if (space.wall[a] < IndexSpace::kNoWall) farthest = Max(farthest, space.wall_end[a] - space.wall[a]);
  }
  return farthest;
}

}  // namespace voxelpipe
