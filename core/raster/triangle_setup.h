// Triangle set-up: everything about a triangle that all its rows share.
//
// Sources: T. Akenine-Moller, "Fast 3D Triangle-Box Overlap Testing", 2001 (the 13 axes); J. Pantaleoni, "VoxelPipe",
// HPG 2011, section 3.1 (set-up factored out of the inner loops). Changed: an axis test is kept as a slab
// lo <= n.(x,y,z) <= hi over integer voxel coordinates, so that for a fixed row every test is linear in x and the
// voxels of the row form one interval (spans.h); and the arithmetic is arranged so that its error is bounded, see below.
//
// Exactness. Coordinates are doubles in index space, made local to the triangle's first voxel. The two edges that leave v0
// are rounded to a common power-of-two grid, so that the third edge is exact and the rounded triangle is a true triangle
// within 2^-51 of its extent E of the given one. Cross products use the exact remainder of fma, so a sliver's
// normal keeps full relative precision. What is left are a handful of roundings relative to |n|_1 * E; the widening of every
// slab, max(1e-6, 2^-44 E) voxels per unit of |n|_1, is more than a hundred times that. A widened test of all 13 axes is
// the exact test of a voxel grown by the widening: nothing is missed and what is added lies within it.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "base/vec.h"
#include "raster/coverage.h"

namespace voxelpipe {

// lo <= n.(x,y,z) <= hi for local integer voxel coordinates. `inv_nx` is 1/n.x, or 0 where the slab is parallel to the
// row (n.x contributes nothing over the triangle's extent).
struct AxisSlab {
  double nx = 0, ny = 0, nz = 0;
  double inv_nx = 0;
  double lo = 0, hi = 0;
};

struct TriangleSetup {
  static constexpr int kMaxSlabs = 11;

  Vec3d base;         // index space of the local origin, integer valued: the first voxel of the triangle's box
  Vec3d first, last;  // local voxel range whose boxes touch the triangle's box, inclusive, integer valued
  AxisSlab slabs[kMaxSlabs];
  int slab_count = 0;

  Vec3d v0;                 // local position of the first vertex
  Vec3d e1, e2;             // edges v1 - v0 and v2 - v0, exact
  Vec3d normal;             // a positive multiple of cross(v1 - v0, v2 - v0); 0 if degenerate
  double normal_scale = 1;  // normal = cross(e1, e2) * normal_scale^2
  bool degenerate = false;
};

// a*b - c*d within 1.5 ulp of the result (W. Kahan; Jeannerod, Louvet, Muller, "Further analysis of Kahan's algorithm
// for the accurate computation of 2x2 determinants", 2013).
VOXELPIPE_HD double DifferenceOfProducts(double a, double b, double c, double d) {
  const double cd = c * d;
  const double error = fma(-c, d, cd);
  return fma(a, b, -cd) + error;
}

VOXELPIPE_HD Vec3d AccurateCross(const Vec3d& a, const Vec3d& b) {
  return {DifferenceOfProducts(a.y, b.z, a.z, b.y), DifferenceOfProducts(a.z, b.x, a.x, b.z),
          DifferenceOfProducts(a.x, b.y, a.y, b.x)};
}

// The smallest power of two above a positive normal v, by its exponent bits.
VOXELPIPE_HD double PowerOfTwoAbove(double v) {
  uint64_t bits;
  memcpy(&bits, &v, sizeof bits);
  bits = ((bits >> 52) + 1) << 52;
  double power;
  memcpy(&power, &bits, sizeof power);
  return power;
}

namespace setup_internal {

VOXELPIPE_HD double MaxAbs(const Vec3d& v) {
  return Max(Abs(v.x), Max(Abs(v.y), Abs(v.z)));
}
VOXELPIPE_HD Vec3d RoundTo(const Vec3d& v, double magic) {
  return {(v.x + magic) - magic, (v.y + magic) - magic, (v.z + magic) - magic};
}

struct Box {
  Vec3d half;       // half sizes of the box around the voxel's centre
  double widening;  // voxels
};

// Adds the slab of axis n. The triangle projects to [tmin, tmax]; `reach` is half of what the voxel's box projects to.
VOXELPIPE_HD void AddSlab(TriangleSetup& s, const Vec3d& n, double tmin, double tmax, double reach, double extent) {
  const double norm = (Abs(n.x) + Abs(n.y)) + Abs(n.z);
  if (norm == 0) return;  // a zero axis separates nothing
  AxisSlab& slab = s.slabs[s.slab_count++];
  slab.nx = n.x;
  slab.ny = n.y;
  slab.nz = n.z;
  const double centre = 0.5 * ((n.x + n.y) + n.z);
  slab.lo = tmin - reach - centre;
  slab.hi = tmax + reach - centre;
  // Below 2^-40 of the axis over the whole extent, n.x cannot move the test by more than the widening allows for.
  const bool parallel = Abs(n.x) * (extent + 2) <= norm * 0x1p-40;
  slab.inv_nx = parallel ? 0.0 : 1.0 / n.x;
}

VOXELPIPE_HD double Reach(const Vec3d& n, const Box& box) {
  return (Abs(n.x) * (box.half.x + box.widening) + Abs(n.y) * (box.half.y + box.widening)) +
         Abs(n.z) * (box.half.z + box.widening);
}

// The axis f x unit(axis) of an edge direction f through point p. `opposite` is how far the third vertex projects from
// the edge: the same for all three edges of a triangle, minus the component of the normal along `axis`.
VOXELPIPE_HD void AddEdgeSlab(TriangleSetup& s, int axis, const Vec3d& f, const Vec3d& p, double opposite,
                              const Box& box, double extent) {
  const int u = axis == 2 ? 0 : axis + 1, w = axis == 0 ? 2 : axis - 1;
  Vec3d n{0, 0, 0};
  n[u] = f[w];
  n[w] = -f[u];
  const double at_edge = n[u] * p[u] + n[w] * p[w];
  const double at_opposite = at_edge + opposite;
  AddSlab(s, n, Min(at_edge, at_opposite), Max(at_edge, at_opposite), Reach(n, box), extent);
}

}  // namespace setup_internal

// In: the three vertices in index space (double, finite, within 2^40 voxels), the coverage, and the least widening in
// voxels (kMinWidening; the tile binning asks for more). Out: the set-up, independent of grid, tile and batch.
VOXELPIPE_HD TriangleSetup SetUpTriangle(const Vec3d& a, const Vec3d& b, const Vec3d& c, Coverage coverage,
                                         double min_widening = kMinWidening) {
  using namespace setup_internal;
  TriangleSetup s;
  for (int i = 0; i < 3; ++i) s.base[i] = floor(Min(a[i], Min(b[i], c[i])));
  s.v0 = a - s.base;
  s.e1 = b - a;
  s.e2 = c - a;
  double scale = 1;  // 1 / (power of two above the longest edge component)
  const double longest = Max(MaxAbs(s.e1), MaxAbs(s.e2));
  if (longest < 0x1p-900) {
    s.e1 = s.e2 = Vec3d{};  // a point: below every rounding of its own coordinates
  } else {
    const double power = PowerOfTwoAbove(longest);
    s.e1 = RoundTo(s.e1, 3 * power);
    s.e2 = RoundTo(s.e2, 3 * power);
    scale = 1 / power;
  }
  // Scaled edges lie in [-1, 1], so that products neither overflow nor underflow.
  Vec3d f1 = s.e1 * scale, f2 = s.e2 * scale, f3 = f2 - f1;
  s.normal = AccurateCross(f1, f2);
  s.normal_scale = scale;
  const double l1 = Dot(f1, f1), l2 = Dot(f2, f2), l3 = Dot(f3, f3);
  const double longest_squared = Max(l1, Max(l2, l3));
  s.degenerate = MaxAbs(s.normal) <= kDegenerateRatio * longest_squared;
  if (s.degenerate) {  // keep the longest edge only: a segment, or a point
    s.normal = Vec3d{};
    if (l1 >= l2 && l1 >= l3) {
      f2 = f1;
      s.e2 = s.e1;
    } else if (l2 >= l3) {
      f1 = f2;
      s.e1 = s.e2;
    } else {
      f1 = f2 = f3;
      s.v0 = s.v0 + s.e1;
      s.e1 = s.e2 = s.e2 - s.e1;
    }
    f3 = Vec3d{};
  }
  const Vec3d p1 = s.v0 + s.e1, p2 = s.v0 + s.e2;

  const double extent = Max(MaxAbs(s.e1), MaxAbs(s.e2));
  Box box{{0.5, 0.5, 0.5}, Max(min_widening, extent * 0x1p-44)};
  const bool segment_only = coverage == Coverage::kCenter && !s.degenerate;
  if (segment_only) {
    const int axis = DominantAxis(s.normal);
    for (int i = 0; i < 3; ++i) box.half[i] = i == axis ? 0.5 : 0.0;
  }
  for (int i = 0; i < 3; ++i) {
    const double lo = Min(s.v0[i], Min(p1[i], p2[i])), hi = Max(s.v0[i], Max(p1[i], p2[i]));
    s.first[i] = ceil(((lo - 0.5) - box.half[i]) - box.widening);
    s.last[i] = floor(((hi - 0.5) + box.half[i]) + box.widening);
  }

  // The nine edge axes; those along x do not depend on x and reject a row before any division.
  const double unscale = 1 / scale;
  for (int axis = 0; axis < 3; ++axis) {
    const double opposite = -s.normal[axis] * unscale;
    AddEdgeSlab(s, axis, f1, s.v0, opposite, box, extent);
    if (s.degenerate) continue;
    AddEdgeSlab(s, axis, f3, p1, opposite, box, extent);
    AddEdgeSlab(s, axis, f2, s.v0, -opposite, box, extent);
  }
  if (!s.degenerate) {
    const double plane = Dot(s.normal, s.v0);
    double reach = Reach(s.normal, box);
    if (coverage == Coverage::kThin) {  // the slab around the centre is inside the voxel's own
      const double norm = (Abs(s.normal.x) + Abs(s.normal.y)) + Abs(s.normal.z);
      reach = 0.5 * MaxAbs(s.normal) + box.widening * norm;
    }
    AddSlab(s, s.normal, plane, plane, reach, extent);
  }
  return s;
}

}  // namespace voxelpipe
