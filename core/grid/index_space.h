// From world space to index space, where coverage is decided.
#pragma once

#include "base/vec.h"

namespace voxelpipe {

// In: a grid's origin and voxel size, a point in world units. Out: the point in voxels from the grid's first corner, of
// a grid without walls (IndexSpace).
VOXELPIPE_HD Vec3d WorldToIndex(const Vec3d& origin, const Vec3d& voxel_size, const Vec3d& p) {
  return {(p.x - origin.x) / voxel_size.x, (p.y - origin.y) / voxel_size.y, (p.z - origin.z) / voxel_size.z};
}

// Where a grid lies. Positions are float32, so the far side of a mesh that is a whole number of voxels long may lie a
// rounding beyond the last of them: a grid that is fitted to a mesh has a wall on each such axis (FitGrid), and what
// lies beyond it, but not beyond its end, is taken for lying on it.
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

// How far a wall lies from its end at most: by so much it may move a vertex. Voxels; 0 without walls.
inline double FarthestToWall(const IndexSpace& space) {
  double farthest = 0;
  for (int a = 0; a < 3; ++a) {
    if (space.wall[a] < IndexSpace::kNoWall) farthest = Max(farthest, space.wall_end[a] - space.wall[a]);
  }
  return farthest;
}

}  // namespace voxelpipe
