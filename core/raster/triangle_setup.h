// Triangle set-up: everything that all rows of a triangle share.
//
// Sources: T. Akenine-Moller, "Fast 3D Triangle-Box Overlap Testing", 2001 (the 13 axes); J. Pantaleoni, "VoxelPipe",
// HPG 2011, section 3.1 (set-up factored out of the inner loops). Changed: every axis test is solved for one
// coordinate, so that a layer z bounds the rows y, and a row (y,z) bounds the voxels x (spans.h); and the arithmetic is
// arranged so that its error is bounded, see below.
//
// A test of axis n reads lo <= n.(x,y,z) <= hi over integer voxel coordinates local to the triangle's first voxel. The
// nine edge axes lie in the planes (y,z), (z,x) and (x,y), so each has two components: those of (y,z) bound y for a
// given z, the others bound x for a given z or y. The triangle's own plane bounds x, or y where it is parallel to x. A
// test whose solved component vanishes adds nothing to the triangle's box and is left out.
//
// Precision. The class of a triangle depends on its three index-space vertices and the coverage alone:
//   run     conservative only: a box one voxel wide on two axes. A triangle is connected, so it touches every voxel of
//           the box.
//   narrow  float32: edges of 2^-20 to 32 voxels, and the height not below 1/256 of the longest edge
//   wide    double: everything else
// The two edges at v0 are rounded to a common power-of-two grid (2^-23 of the extent E in float, 2^-51 in double), so
// that the third edge is exact and the rounded triangle is a true triangle within half a quantum of the given one. Edge
// axes then have exact coefficients, and the cross product (Kahan) keeps full relative precision. What is left, in
// voxels per unit of |n|_1, narrow: vertex rounding 2^-19, products and sums of coordinates up to 34, 12 x 34 x 2^-24,
// the plane of the rounded triangle one voxel beyond its edge 2^-23 L/h <= 2^-15; together below 6e-5. Wide: a few
// roundings relative to E, below 2^-50 E. Every test is widened: 2^-12 narrow, max(1e-6, 2^-44 E) wide. A widened test
// of all 13 axes is the exact test of a voxel grown by the widening: nothing is missed, and every added voxel lies
// within the widening.
#pragma once

#include "raster/coverage.h"
#include "raster/triangle_plane.h"

namespace voxelpipe {

enum class SpanClass : unsigned char { kRun, kNarrow, kWide };

inline constexpr double kNarrowWidening = 0x1p-12;              // voxels
inline constexpr double kMinNarrow = 0x1p-20, kMaxNarrow = 32;  // voxels, longest edge component
inline constexpr float kNarrowRatio = 0x1p-8f;                  // max|n_i| to (longest edge)^2

// lo - s*t <= u <= hi - s*t: a bound of local coordinate u given local coordinate t.
template <typename Real>
struct Bound {
  Real s, lo, hi;
};

template <typename Real>
struct SpanBounds {
  Real first[3], last[3];  // local voxels whose boxes touch the triangle's box, inclusive, integer valued
  Bound<Real> y_of_z[4];   // three edges, and the plane where it is parallel to x
  Bound<Real> x_of_z[3];
  Bound<Real> x_of_y[3];
  // The plane: lo - sz*z - sy*y <= x <= hi - sz*z - sy*y.
  Bound<Real> plane;  // s = sz
  Real plane_sy;
};

// Takes the place of SpanBounds where kBoundsParts threads share a set-up: thread `number` writes the bounds of one
// edge, or those of the box and the plane, to `out`. Every thread does the rest of the set-up.
inline constexpr int kBoundsParts = 4;
template <typename Real>
struct BoundsPart {
  SpanBounds<Real>& out;
  int number;
  Real first[3], last[3];  // as in SpanBounds
};

struct TriangleSetup {
  SpanClass span_class;
  Vec3d base;                 // index space of the local origin, integer valued: the first voxel of the triangle's box
  Vec3d box_first, box_last;  // the box's voxels in grid coordinates, inclusive, integer valued
  SpanBounds<float> narrow;   // set for its class only
  SpanBounds<double> wide;
};

// Minimum and maximum of two numbers, neither NaN, by the device's own instruction if it has one. Which of two zeros
// they return does not affect a span.
template <typename Real>
VOXELPIPE_HD Real Lesser(Real a, Real b) {
#if defined(__CUDA_ARCH__)
  if constexpr (sizeof(Real) == sizeof(float)) return fminf(a, b);
#endif
  return Min(a, b);
}
template <typename Real>
VOXELPIPE_HD Real Greater(Real a, Real b) {
#if defined(__CUDA_ARCH__)
  if constexpr (sizeof(Real) == sizeof(float)) return fmaxf(a, b);
#endif
  return Max(a, b);
}

namespace setup_internal {

// Input of the bounds. Edges f are e * scale; positions are not scaled.
template <typename Real>
struct Shape {
  Vec3<Real> v0, v1;      // local positions of the first two vertices
  Vec3<Real> f1, f2, f3;  // v1-v0, v2-v0, v2-v1, scaled
  Vec3<Real> normal;      // cross(f1, f2)
  Real unscale;           // 1 / scale
  Real extent;            // longest edge component, voxels
  Vec3<Real> half;        // half sizes of the box around the voxel's centre
  Real widening;          // voxels
};

// An axis counts as parallel if its component changes the test by less than the widening allows.
template <typename Real>
VOXELPIPE_HD constexpr Real ParallelRatio() {
  return sizeof(Real) == 4 ? Real(0x1p-20) : Real(0x1p-40);
}

template <typename Real>
VOXELPIPE_HD Bound<Real> Unbounded() {
  return {Real(0), Real(-1e30), Real(1e30)};
}

// The bound lo <= nu*u + nt*t <= hi solved for u.
template <typename Real>
VOXELPIPE_HD Bound<Real> Solve(Real nu, Real nt, Real lo, Real hi) {
  const Real inverse = Real(1) / nu;
  const Real a = lo * inverse, b = hi * inverse;
  return {nt * inverse, Lesser(a, b), Greater(a, b)};
}

// The axis (nu, nt) of an edge through the point with coordinates (pu, pt); `opposite` is how far the third vertex
// projects from the edge.
template <typename Real>
VOXELPIPE_HD Bound<Real> EdgeBound(Real nu, Real nt, Real pu, Real pt, Real opposite, Real half_u, Real half_t,
                                   const Shape<Real>& shape) {
  const Real au = Abs(nu), at = Abs(nt);
  if (au * (shape.extent + Real(2)) <= (au + at) * ParallelRatio<Real>()) return Unbounded<Real>();
  const Real edge = nu * pu + nt * pt;
  const Real other = edge + opposite;
  const Real reach = au * (half_u + shape.widening) + at * (half_t + shape.widening);
  const Real centre = Real(0.5) * (nu + nt);
  return Solve(nu, nt, (Lesser(edge, other) - reach) - centre, (Greater(edge, other) + reach) - centre);
}

// The three axes of edge f through p, numbered i. `side`, +1 or -1: the side of the edge, seen along the normal, on
// which the third vertex lies.
template <typename Real>
VOXELPIPE_HD void BoundEdge(const Shape<Real>& shape, int i, const Vec3<Real>& f, const Vec3<Real>& p, Real side,
                            SpanBounds<Real>& out) {
  const Vec3<Real> opposite = shape.normal * (side * shape.unscale);
  const Vec3<Real>& half = shape.half;
  out.y_of_z[i] = EdgeBound(f.z, -f.y, p.y, p.z, opposite.x, half.y, half.z, shape);
  out.x_of_z[i] = EdgeBound(-f.z, f.x, p.x, p.z, opposite.y, half.x, half.z, shape);
  out.x_of_y[i] = EdgeBound(f.y, -f.x, p.x, p.y, opposite.z, half.x, half.y, shape);
}

template <typename Real>
VOXELPIPE_HD void BoundPlane(const Shape<Real>& shape, Coverage coverage, SpanBounds<Real>& out) {
  const Vec3<Real>& n = shape.normal;
  const Real ax = Abs(n.x), ay = Abs(n.y), az = Abs(n.z);
  const Real norm = (ax + ay) + az;
  Real reach = (ax * (shape.half.x + shape.widening) + ay * (shape.half.y + shape.widening)) +
               az * (shape.half.z + shape.widening);
  if (coverage == Coverage::kThin) reach = Real(0.5) * Max(ax, Max(ay, az)) + shape.widening * norm;
  const Real at = (n.x * shape.v0.x + n.y * shape.v0.y) + n.z * shape.v0.z;
  const Real centre = Real(0.5) * ((n.x + n.y) + n.z);
  const Real lo = (at - reach) - centre, hi = (at + reach) - centre;
  const Real far = shape.extent + Real(2), parallel = norm * ParallelRatio<Real>();
  out.plane = Unbounded<Real>();
  out.plane_sy = Real(0);
  out.y_of_z[3] = Unbounded<Real>();
  if (ax * far > parallel) {
    out.plane = Solve(n.x, n.z, lo, hi);
    out.plane_sy = n.y * (Real(1) / n.x);
  } else if (ay * far > parallel) {
    out.y_of_z[3] = Solve(n.y, n.z, lo, hi);
  }
}

template <typename Real>
VOXELPIPE_HD void BoundShape(const Shape<Real>& shape, Coverage coverage, SpanBounds<Real>& out) {
  BoundEdge(shape, 0, shape.f1, shape.v0, Real(-1), out);
  BoundEdge(shape, 1, shape.f3, shape.v1, Real(-1), out);
  BoundEdge(shape, 2, shape.f2, shape.v0, Real(1), out);
  BoundPlane(shape, coverage, out);
}
// The same, but only the bounds of this part.
template <typename Real>
VOXELPIPE_HD void BoundShape(const Shape<Real>& shape, Coverage coverage, BoundsPart<Real>& part) {
  SpanBounds<Real>& out = part.out;
  if (part.number < 3) {
    const bool second = part.number == 1, third = part.number == 2;
    Vec3<Real> f, p;
    for (int a = 0; a < 3; ++a) {
      f[a] = second ? shape.f3[a] : third ? shape.f2[a] : shape.f1[a];
      p[a] = second ? shape.v1[a] : shape.v0[a];
    }
    BoundEdge(shape, part.number, f, p, third ? Real(1) : Real(-1), out);
    return;
  }
  for (int a = 0; a < 3; ++a) {
    out.first[a] = part.first[a];
    out.last[a] = part.last[a];
  }
  BoundPlane(shape, coverage, out);
}

// Half sizes of the box that stands for the voxel (coverage.h).
template <typename Real>
VOXELPIPE_HD Vec3<Real> HalfSizes(Coverage coverage, const Vec3<Real>& normal) {
  if (coverage != Coverage::kCenter) return {Real(0.5), Real(0.5), Real(0.5)};
  const int axis = DominantAxis(normal);
  return {axis == 0 ? Real(0.5) : Real(0), axis == 1 ? Real(0.5) : Real(0), axis == 2 ? Real(0.5) : Real(0)};
}

VOXELPIPE_HD float ToFloat(double v) {
  return float(v);
}
VOXELPIPE_HD Vec3f ToFloat(const Vec3d& v) {
  return {float(v.x), float(v.y), float(v.z)};
}

// The first and last voxel along an axis whose widened box of half size `half` about its centre touches [lo, hi].
VOXELPIPE_HD double FirstVoxel(double lo, double half, double widening) {
  return ceil(lo - ((0.5 + half) + widening));
}
VOXELPIPE_HD double LastVoxel(double hi, double half, double widening) {
  return floor(hi - ((0.5 - half) - widening));
}

// Sets `shape` up for a narrow triangle; false if it is not one.
VOXELPIPE_HD bool NarrowShape(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& base, Shape<float>& shape) {
  const Vec3d e1 = b - a, e2 = c - a;
  const double longest = Max(MaxAbs(e1), MaxAbs(e2));
  if (!(longest >= kMinNarrow && longest <= kMaxNarrow)) return false;
  const double magic = PowerOfTwoAbove(longest) * 0x1.8p29;  // last place: 2^-23 of the power
  shape.f1 = ToFloat(RoundTo(e1, magic));
  shape.f2 = ToFloat(RoundTo(e2, magic));
  shape.f3 = shape.f2 - shape.f1;
  shape.normal = AccurateCross(shape.f1, shape.f2);
  const float l1 = Dot(shape.f1, shape.f1), l2 = Dot(shape.f2, shape.f2), l3 = Dot(shape.f3, shape.f3);
  if (MaxAbs(shape.normal) < kNarrowRatio * Max(l1, Max(l2, l3))) return false;
  shape.v0 = ToFloat(a - base);
  shape.v1 = shape.v0 + shape.f1;
  shape.unscale = 1;
  shape.extent = Max(MaxAbs(shape.f1), MaxAbs(shape.f2));
  shape.widening = float(kNarrowWidening);
  return true;
}

template <typename Setup>
VOXELPIPE_HD void SetUpWide(const Vec3d& a, const Vec3d& b, const Vec3d& c, Coverage coverage, double min_widening,
                            Setup& s) {
  const TrianglePlane plane = SetUpPlane(a, b, c);
  Shape<double> shape;
  shape.v0 = plane.v0;
  shape.v1 = plane.v0 + plane.e1;
  shape.f1 = plane.e1 * plane.normal_scale;
  shape.f2 = plane.e2 * plane.normal_scale;
  shape.f3 = shape.f2 - shape.f1;
  shape.normal = plane.normal;
  shape.unscale = 1 / plane.normal_scale;
  shape.extent = Max(MaxAbs(plane.e1), MaxAbs(plane.e2));
  shape.widening = Max(min_widening, shape.extent * 0x1p-44);
  const Coverage effective = plane.degenerate ? Coverage::kConservative : coverage;
  shape.half = HalfSizes(effective, plane.normal);
  const Vec3d v2 = plane.v0 + plane.e2;
  for (int i = 0; i < 3; ++i) {
    const double lo = Min(shape.v0[i], Min(shape.v1[i], v2[i])), hi = Max(shape.v0[i], Max(shape.v1[i], v2[i]));
    s.wide.first[i] = ceil(((lo - 0.5) - shape.half[i]) - shape.widening);
    s.wide.last[i] = floor(((hi - 0.5) + shape.half[i]) + shape.widening);
    s.box_first[i] = s.base[i] + s.wide.first[i];
    s.box_last[i] = s.base[i] + s.wide.last[i];
  }
  s.span_class = SpanClass::kWide;
  BoundShape(shape, effective, s.wide);
}

}  // namespace setup_internal

// In: the three vertices in index space (double, finite, within 2^40 voxels), the coverage. Out: the set-up,
// independent of grid, tile and batch. `Setup` has the members of TriangleSetup; its bounds may be references to other
// storage, or BoundsPart.
template <typename Setup>
VOXELPIPE_HD void SetUpTriangle(const Vec3d& a, const Vec3d& b, const Vec3d& c, Coverage coverage, Setup& s) {
  using namespace setup_internal;
  Vec3d lo, hi;
  for (int i = 0; i < 3; ++i) {
    lo[i] = Min(a[i], Min(b[i], c[i]));
    hi[i] = Max(a[i], Max(b[i], c[i]));
    s.base[i] = floor(lo[i]);
    s.box_first[i] = FirstVoxel(lo[i], 0.5, kNarrowWidening);
    s.box_last[i] = LastVoxel(hi[i], 0.5, kNarrowWidening);
  }
  if (coverage == Coverage::kConservative) {
    const int single =
        (s.box_first.x == s.box_last.x) + (s.box_first.y == s.box_last.y) + (s.box_first.z == s.box_last.z);
    if (single >= 2) {
      s.span_class = SpanClass::kRun;
      return;
    }
  }
  Shape<float> shape;
  if (!NarrowShape(a, b, c, s.base, shape)) {
    SetUpWide(a, b, c, coverage, kMinWidening, s);
    return;
  }
  s.span_class = SpanClass::kNarrow;
  shape.half = HalfSizes(coverage, shape.normal);
  for (int i = 0; i < 3; ++i) {
    if (coverage == Coverage::kCenter) {
      s.box_first[i] = FirstVoxel(lo[i], double(shape.half[i]), kNarrowWidening);
      s.box_last[i] = LastVoxel(hi[i], double(shape.half[i]), kNarrowWidening);
    }
    s.narrow.first[i] = float(s.box_first[i] - s.base[i]);
    s.narrow.last[i] = float(s.box_last[i] - s.base[i]);
  }
  BoundShape(shape, coverage, s.narrow);
}
VOXELPIPE_HD TriangleSetup SetUpTriangle(const Vec3d& a, const Vec3d& b, const Vec3d& c, Coverage coverage) {
  TriangleSetup s;
  SetUpTriangle(a, b, c, coverage, s);
  return s;
}

// The same in double for every triangle, widened by at least `min_widening` voxels: for binning, which must miss no
// tile.
VOXELPIPE_HD TriangleSetup SetUpWideTriangle(const Vec3d& a, const Vec3d& b, const Vec3d& c, Coverage coverage,
                                             double min_widening) {
  TriangleSetup s;
  for (int i = 0; i < 3; ++i) s.base[i] = floor(Min(a[i], Min(b[i], c[i])));
  setup_internal::SetUpWide(a, b, c, coverage, min_widening, s);
  return s;
}

}  // namespace voxelpipe
