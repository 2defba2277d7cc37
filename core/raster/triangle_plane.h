// The plane of a triangle in double precision: what shading and crossings need, apart from coverage.
#pragma once

#include "raster/coverage.h"
#include "raster/exact_math.h"

namespace voxelpipe {

struct TrianglePlane {
  Vec3d base;    // index space of the local origin, integer valued: the corner of the first voxel of the triangle's box
  Vec3d v0;      // local position of the first vertex; under `degenerate` an end of the longest edge
  Vec3d e1, e2;  // edges v1 - v0 and v2 - v0, exact; both the longest edge under `degenerate`
  Vec3d normal;  // a positive multiple of cross(v1 - v0, v2 - v0); 0 if degenerate
  double normal_scale = 1;  // normal = cross(e1, e2) * normal_scale^2
  bool degenerate = false;  // max|n_i| <= kDegenerateRatio * (longest edge)^2
};

// In: the three vertices in index space (double, finite, within 2^40 voxels). The two edges that leave v0 are rounded
// to a common power-of-two grid, so that the third edge is exact and the rounded triangle is a true triangle within
// 2^-51 of its extent of the given one; the normal then keeps full relative precision even for slivers.
VOXELPIPE_HD TrianglePlane SetUpPlane(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  TrianglePlane s;
  for (int i = 0; i < 3; ++i) s.base[i] = floor(Min(a[i], Min(b[i], c[i])));
  s.v0 = a - s.base;
  s.e1 = b - a;
  s.e2 = c - a;
  const double longest = Max(MaxAbs(s.e1), MaxAbs(s.e2));
  if (longest < 0x1p-900) {
    s.e1 = s.e2 = Vec3d{};  // a point: shorter than any rounding of its coordinates
  } else {
    const double power = PowerOfTwoAbove(longest);
    s.e1 = RoundTo(s.e1, 3 * power);
    s.e2 = RoundTo(s.e2, 3 * power);
    s.normal_scale = 1 / power;
  }
  // Scaled edges lie in [-1, 1], so that products neither overflow nor underflow.
  const Vec3d f1 = s.e1 * s.normal_scale, f2 = s.e2 * s.normal_scale, f3 = f2 - f1;
  s.normal = AccurateCross(f1, f2);
  const double l1 = Dot(f1, f1), l2 = Dot(f2, f2), l3 = Dot(f3, f3);
  s.degenerate = MaxAbs(s.normal) <= kDegenerateRatio * Max(l1, Max(l2, l3));
  if (!s.degenerate) return s;
  s.normal = Vec3d{};
  if (l1 >= l2 && l1 >= l3) {
    s.e2 = s.e1;
  } else if (l2 >= l3) {
    s.e1 = s.e2;
  } else {
    s.v0 = s.v0 + s.e1;
    s.e1 = s.e2 = s.e2 - s.e1;
  }
  return s;
}

// Barycentric coordinates of voxel (x,y,z)'s centre (grid coordinates): projected onto the plane along its normal,
// negative ones set to 0, renormalized; 1/3 each for a degenerate triangle. Index space, evaluated in double.
VOXELPIPE_HD Vec3f Barycentrics(const TrianglePlane& s, int64_t x, int64_t y, int64_t z) {
  const float third = 1.0f / 3.0f;
  if (s.degenerate) return {third, third, third};
  const Vec3d centre{(double(x) - s.base.x) + 0.5, (double(y) - s.base.y) + 0.5, (double(z) - s.base.z) + 0.5};
  const Vec3d d = (centre - s.v0) * s.normal_scale;
  const Vec3d f1 = s.e1 * s.normal_scale, f2 = s.e2 * s.normal_scale;
  const double nn = Dot(s.normal, s.normal);
  double b1 = Dot(Cross(d, f2), s.normal) / nn;
  double b2 = Dot(Cross(f1, d), s.normal) / nn;
  double b0 = (1 - b1) - b2;
  b0 = Max(b0, 0.0);
  b1 = Max(b1, 0.0);
  b2 = Max(b2, 0.0);
  const double sum = (b0 + b1) + b2;
  return {float(b0 / sum), float(b1 / sum), float(b2 / sum)};
}

}  // namespace voxelpipe
