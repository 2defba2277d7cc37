// Which triangles are degenerate in index space, told from world space: most are so far from it that none of their
// vertices need be placed for it. No host-only includes.
#pragma once

#include "grid/index_space.h"
#include "raster/triangle_plane.h"

namespace voxelpipe {

struct DegenerateTest {
  IndexSpace space;
  Vec3f inverse_size;
  // Of the square of an edge, in voxels: from there on what rounding does to vertices in index space is small. Where
  // floats might not hold what edges are made of, more than any is taken for.
  float least = kMost;
  // Of the square of a normal (a cross product of edges) in world space: a triangle within two voxels along each axis
  // whose normal is that long is not degenerate, and that square lies within 2^-120 and 2^100. kNever where nothing is
  // certain.
  double least_small = kNever;

  static constexpr float kMost = 0x1p100f;
  static constexpr double kNever = 0x1p1000;
};

// In: where the grid lies, two corners in index space of a box that holds all vertices.
inline DegenerateTest MakeDegenerateTest(const IndexSpace& space, const Vec3d& least, const Vec3d& most) {
  const Vec3d& voxel_size = space.voxel_size;
  DegenerateTest test;
  test.space = space;
  bool usual = true;
  for (int a = 0; a < 3; ++a) {
    usual = usual && voxel_size[a] >= 0x1p-60 && voxel_size[a] <= 0x1p60;
    test.inverse_size[a] = float(1 / voxel_size[a]);
  }
  if (!usual) return test;
  const double reach = Max(MaxAbs(least), MaxAbs(most));
  // Vertices beyond a wall move by so much. Of an edge that is 2^14 times as long that moves a normal by less than a
  // thousandth of the square's quarter.
  const double moved = FarthestToWall(space);
  const auto edge = float(Max(reach * 0x1p-30, moved * 0x1p14));
  test.least = Max(edge * edge, 0x1p-100f);
  // The longest edge of such a triangle has a square of less than 13 voxels, and roundings of its corners in index
  // space move its normal there by less than 2^-30 of a square voxel, and so do walls: with a component of kSmall that
  // is far from kDegenerateRatio.
  constexpr double kSmall = 0x1p-26;
  static_assert(13 * kDegenerateRatio + 0x1p-30 < kSmall / 2);
  const double face = Max(voxel_size.x * voxel_size.y, Max(voxel_size.y * voxel_size.z, voxel_size.z * voxel_size.x));
  const double squared = face * face;
  if (reach < 0x1p16 && moved <= 0x1p-36 && squared >= 0x1p-100 && squared <= 0x1p90) {
    test.least_small = Max(3 * kSmall * kSmall * squared, 0x1p-120);
  }
  return test;
}

VOXELPIPE_HD_CALL bool IsPlacedDegenerate(const DegenerateTest& test, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const Vec3d p[3] = {WorldToIndex(test.space, a), WorldToIndex(test.space, b), WorldToIndex(test.space, c)};
  return SetUpPlane(p[0], p[1], p[2]).degenerate;
}

// Of a triangle in world space; the same answer as SetUpPlane gives of the vertices in index space. Edges here are off
// from those by a few parts in 2^23 for roundings to float, and by 2^-21 of the longest for those of the vertices, so
// that the normal is off by less than 2^-16 of the longest's square. What has a normal of a thousandth of that is far
// from kDegenerateRatio.
VOXELPIPE_HD bool IsDegenerate(const DegenerateTest& test, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  static_assert(kDegenerateRatio < 1e-6);
  const Vec3d d1 = b - a, d2 = c - a;
  const Vec3f& inverse = test.inverse_size;
  const Vec3f e1{float(d1.x) * inverse.x, float(d1.y) * inverse.y, float(d1.z) * inverse.z};
  const Vec3f e2{float(d2.x) * inverse.x, float(d2.y) * inverse.y, float(d2.z) * inverse.z};
  const Vec3f e3 = e2 - e1;
  const float longest = Max(Dot(e1, e1), Max(Dot(e2, e2), Dot(e3, e3)));
  if (longest >= test.least && longest < DegenerateTest::kMost && MaxAbs(Cross(e1, e2)) > 0.001f * longest)
    return false;
  return IsPlacedDegenerate(test, a, b, c);
}

}  // namespace voxelpipe
