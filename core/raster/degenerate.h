// Finds the triangles that are degenerate in index space from their vertices in world space. No host-only includes.
//
// A floating-point filter decides most triangles without transforming a vertex to index space; IsPlacedDegenerate
// decides the rest by the definition. Filters with an exact fallback: J. R. Shewchuk, "Adaptive Precision
// Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997.
#pragma once

#include "grid/index_space.h"
#include "raster/triangle_plane.h"

namespace voxelpipe {

struct DegenerateTest {
  IndexSpace space;
  Vec3f inverse_size;
  // Smallest squared length of the longest edge, in voxels^2, for which the rounding of vertices in index space is
  // negligible. kMaxSquared, which turns the filter off, if float might not hold the edges.
  float min_edge_squared = kMaxSquared;
  // Smallest squared length of a normal (cross product of two edges in world space) that proves a triangle of at most
  // two voxels an axis not degenerate. Such squares lie within 2^-120 and 2^100. kNever if nothing can be proved.
  double least_small = kNever;

  static constexpr float kMaxSquared = 0x1p100f;
  static constexpr double kNever = 0x1p1000;
};

// In: the index space of the grid; the two corners, in index space, of a box that contains all vertices.
inline DegenerateTest MakeDegenerateTest(const IndexSpace& space, const Vec3d& box_min, const Vec3d& box_max) {
  const Vec3d& voxel_size = space.voxel_size;
  DegenerateTest test;
  test.space = space;
  bool usual = true;
  for (int a = 0; a < 3; ++a) {
    usual = usual && voxel_size[a] >= 0x1p-60 && voxel_size[a] <= 0x1p60;
    test.inverse_size[a] = float(1 / voxel_size[a]);
  }
  if (!usual) return test;
  const double reach = Max(MaxAbs(box_min), MaxAbs(box_max));
  // A wall moves vertices by at most `moved`. If the longest edge is 2^14 times as long, that changes the normal by
  // less than a thousandth of a quarter of the edge's square.
  const double moved = FarthestToWall(space);
  const auto edge = float(Max(reach * 0x1p-30, moved * 0x1p14));
  test.min_edge_squared = Max(edge * edge, 0x1p-100f);
  // The longest edge of such a triangle has a square below 13 voxels^2. The rounding of its vertices in index space
  // changes its normal there by less than 2^-30 voxels^2, and so do walls. With a component of kSmall the normal is far
  // from kDegenerateRatio.
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

// In: a triangle in world space. Out: `degenerate` of SetUpPlane for its vertices in index space. Edges here differ
// from the edges there by a few parts in 2^23 (rounding to float) and by 2^-21 of the longest edge (rounding of the
// vertices), so the normal differs by less than 2^-16 of the square of the longest edge. A normal longer than a
// thousandth of that square is far from kDegenerateRatio.
VOXELPIPE_HD bool IsDegenerate(const DegenerateTest& test, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  static_assert(kDegenerateRatio < 1e-6);
  const Vec3d d1 = b - a, d2 = c - a;
  const Vec3f& inverse = test.inverse_size;
  const Vec3f e1{float(d1.x) * inverse.x, float(d1.y) * inverse.y, float(d1.z) * inverse.z};
  const Vec3f e2{float(d2.x) * inverse.x, float(d2.y) * inverse.y, float(d2.z) * inverse.z};
  const Vec3f e3 = e2 - e1;
  const float longest = Max(Dot(e1, e1), Max(Dot(e2, e2), Dot(e3, e3)));
  if (longest >= test.min_edge_squared && longest < DegenerateTest::kMaxSquared &&
      MaxAbs(Cross(e1, e2)) > 0.001f * longest)
    return false;
  return IsPlacedDegenerate(test, a, b, c);
}

}  // namespace voxelpipe
