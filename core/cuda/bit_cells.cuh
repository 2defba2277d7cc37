// Small triangles and the voxels they touch, by integers and a few float tests: the answer of raster/spans.h where it is certain.
//
// Vertices come to index space as fixed-point integers, one multiply-add a coordinate, which is off by less than two units. With w
// the widening of narrow triangles (raster/triangle_setup.h):
// * The box of voxels is that of raster/triangle_setup.h unless a vertex lies within two units of a voxel's border moved by w.
// * A box of at most two voxels along each axis is eight octants about an inner corner. By the separating-axis theorem
//   the triangle touches all of them but those that one of ten tests takes out: a plane through an edge along an axis that leaves the
//   corner outside by more than w takes out the two octants that it points to, the triangle's own plane the one behind it. The narrow
//   class answers as for a voxel grown by w give or take its roundings. So where no test comes closer to w than those and the fixed
//   point's error together (the band), the triangle touches the same octants grown by anything within it, and the answers agree.
// * Larger boxes go by rows as raster/spans.h has them, each bound once for voxels grown by w and the band, once for w less the band. Where
//   both give the same voxels, so does whatever lies between.
// What is not certain, and triangles that may be of the wide class, go to the code that all schedules share.
#pragma once

#include "cuda/views.h"
#include "raster/triangle_setup.h"

namespace voxelpipe::cuda {

// World space to fixed-point index space.
struct FixedPlace {
  Vec3d scale, offset;
  int bits = 0;                    // after the point; 0: the mesh reaches too far, there are none
  float widening = 0;              // voxel sizes in units
  int margin = 0;                  // the same in whole units
  float band = 0, plane_band = 0;  // likewise, of the tests of edges and of the plane
  float voxel = 0, noise = 0;      // a voxel; what moving vertices by units does to a normal, at most, and some more
  float voxels = 0;                // a unit, in voxels
};

inline constexpr double kFixedMagic = 0x1.8p52;
inline constexpr float kCellBand = 1e-5f, kCellPlaneBand = 4e-5f;  // voxels
inline constexpr float kMoreOfRows = 1e-5f;                        // where boxes are up to 9 voxels large

// In: a grid's origin and voxel size, the mesh's box in its index space.
inline FixedPlace MakeFixedPlace(const Vec3d& origin, const Vec3d& voxel_size, const Vec3d& least, const Vec3d& most) {
  FixedPlace place;
  const double reach = Max(MaxAbs(least), MaxAbs(most));
  const int bits = reach < 2000 ? 20 : reach < 4000 ? 19 : reach < 32000 ? 16 : 0;
  for (int i = 0; i < 3; ++i) {
    const double unit = 1 / voxel_size[i] * double(1 << bits);
    place.scale[i] = unit;
    place.offset[i] = kFixedMagic - origin[i] * unit;
    // The offset loses what lies below a unit, and no more.
    if (!(Abs(origin[i] * unit) < 0x1p50 && unit < 0x1p900)) return place;
  }
  const auto unit = float(1 << bits);
  place.bits = bits;
  place.widening = float(kNarrowWidening) * unit;
  place.margin = int(place.widening);
  // raster/triangle_setup.h: some 17 x size x 2^-24 + 2^-19 for a size of 3 voxels here; and 2^-15 for the plane of a sliver. Four
  // units for the fixed point, one of them for products of an edge and a position.
  place.band = kCellBand * unit + 4;
  place.plane_band = kCellPlaneBand * unit + 4;
  place.voxel = unit;
  place.noise = 0x1p-19f * unit * unit;
  place.voxels = 1 / unit;
  return place;
}

VOXELPIPE_HD int ToFixed(double world, double scale, double offset) {
  const double sum = fma(world, scale, offset);
  uint64_t bits;
  memcpy(&bits, &sum, sizeof bits);
  return int(uint32_t(bits));
}

// A vertex as parts of its mesh's box, counted from the least corner: two thirds of the bytes, in one access of memory.
struct alignas(16) PackedVertex {
  uint32_t at[3];
  uint32_t triangle;  // whose corner it is
};

inline constexpr double kPackedParts = 4294967295.0;  // of the box along an axis

// How long a part is of an axis along which the box is `extent` long, which is finite.
VOXELPIPE_HD double PartOf(double extent) {
  return extent > 0 ? extent / kPackedParts : 1;
}

// The nearest part; of what lies outside of the box, the first or the last.
VOXELPIPE_HD uint32_t PackCoordinate(double p, double least, double part) {
  return uint32_t(Clamp((p - least) / part + 0.5, 0.0, kPackedParts));
}

// Packed vertices to fixed-point index space. The nearest part is off by half a unit at most there, and with what is rounded on the way
// the result is off by less than two, as that of ToFixed.
struct PackedPlace {
  Vec3d scale, offset;
};

// In: a place, what it was made from, and the least corner and the extent of the packed box, which `place` reaches.
inline PackedPlace MakePackedPlace(const FixedPlace& place, const Vec3d& origin, const Vec3d& voxel_size,
                                   const Vec3d& least, const Vec3d& extent) {
  PackedPlace packed;
  for (int i = 0; i < 3; ++i) {
    const double unit = 1 / voxel_size[i] * double(1 << place.bits);
    // A whole multiple of 2^-52, so that what 2^52 of it make is taken off without rounding.
    const double part = extent[i] > 0 ? PartOf(extent[i]) * unit : 0;  // at most a unit: `place` reaches the box
    const auto all = double(int64_t(part * 0x1p52 + 0.5));
    packed.scale[i] = all * 0x1p-52;
    packed.offset[i] = (kFixedMagic - all) + (least[i] - origin[i]) * unit;
  }
  return packed;
}

VOXELPIPE_HD int PackedToFixed(uint32_t parts, double scale, double offset) {
  const uint64_t bits = uint64_t{0x43300000} << 32 | parts;  // 2^52 and the parts
  double value;
  memcpy(&value, &bits, sizeof value);
  return ToFixed(value, scale, offset);
}

// Of a triangle: its box of voxels, inclusive.
struct FixedBox {
  int first[3], last[3];
  bool doubtful;  // one voxel more or less on some side
};

VOXELPIPE_HD FixedBox BoxOf(const int (&v)[3][3], const FixedPlace& place) {
  FixedBox box;
  const int below_voxel = (1 << place.bits) - 1;
  int least = below_voxel;  // of how far the box's sides, moved up by two units, lie behind a voxel's border
  for (int i = 0; i < 3; ++i) {
    const int from = Min(v[0][i], Min(v[1][i], v[2][i])) - (place.margin - 2);
    const int upto = Max(v[0][i], Max(v[1][i], v[2][i])) + (place.margin + 2);
    least = Min(least, Min(from & below_voxel, upto & below_voxel));
    box.first[i] = from >> place.bits;
    box.last[i] = upto >> place.bits;
  }
  box.doubtful = least < 4;
  return box;
}

// All bits set where the sign bit is, none otherwise.
VOXELPIPE_HD uint32_t SignMask(float v) {
  int32_t bits;
  memcpy(&bits, &v, sizeof bits);
  return uint32_t(bits >> 31);
}

struct Octants {
  uint32_t touched;  // bit x + 2y + 4z
  bool doubtful;
};

// The octants on the greater side along an axis.
VOXELPIPE_HD constexpr uint32_t HalfOf(int axis) {
  return axis == 0 ? 0xaa : axis == 1 ? 0xcc : 0xf0;
}

// Takes the bits that `a` and `b` have both out of `octants` where v > 0: on a device an instruction that is left out otherwise, in place of
// values to choose from.
VOXELPIPE_HD void TakeOutIf(float v, uint32_t a, uint32_t b, uint32_t& octants) {
#if defined(__CUDA_ARCH__)
  asm("{ .reg .pred p; setp.gt.f32 p, %1, 0f00000000; @p lop3.b32 %0, %0, %2, %3, 0x70; }"
      : "+r"(octants)
      : "f"(v), "r"(a), "r"(b));
#else
  if (v > 0) octants &= ~(a & b);
#endif
}

// v, with its sign turned where the sign bit of `by` is set.
VOXELPIPE_HD float TurnSign(float v, uint32_t by) {
  uint32_t bits;
  memcpy(&bits, &v, sizeof bits);
  bits ^= by & 0x80000000u;
  memcpy(&v, &bits, sizeof v);
  return v;
}

// Moves the bits up by one and puts the sign of v in the lowest.
VOXELPIPE_HD uint32_t PushSign(uint32_t bits, float v) {
#if defined(__CUDA_ARCH__)
  return __funnelshift_l(__float_as_uint(v), bits, 1);
#else
  return bits << 1 | (SignMask(v) & 1);
#endif
}

// An edge and the signs of its components.
struct CellEdge {
  Vec3f e;
  uint32_t sign[3];
};

// One edge seen along an axis: in the plane of the other two, u and t, from p by the edge. Takes out what lies beyond it, on the side where the
// triangle is not; what the axis' other end, at the opposite vertex, takes out the other edges and the box do as well. `side` has the sign of the
// triangle's area in that plane, `rounding` is what roundings may make of it. `sure` becomes at most the corner's distance from being decided
// otherwise, less what is uncertain of it, times the edge.
template <int kU, int kT>
VOXELPIPE_HD void TestEdge(const CellEdge& edge, const Vec3f& p, uint32_t side, float rounding, const FixedPlace& place,
                           uint32_t& touched, float& sure) {
  const float eu = edge.e[kU], et = edge.e[kT];
  const float norm = fabsf(eu) + fabsf(et);
  const float beyond = fmaf(-place.widening, norm, TurnSign(fmaf(eu, p[kT], -(et * p[kU])), side));
  sure = fminf(sure, fabsf(beyond) - fmaf(place.band, norm, rounding));
  TakeOutIf(beyond, side ^ edge.sign[kT] ^ HalfOf(kU), side ^ edge.sign[kU] ^ ~HalfOf(kT), touched);
}

VOXELPIPE_HD float LengthSquared(const Vec3f& e) {
  return fmaf(e.x, e.x, fmaf(e.y, e.y, e.z * e.z));
}

// Of a number that is 0 or at least 1, to a few parts in a million; what it is off by is part of the band.
VOXELPIPE_HD float RoughSqrt(float v) {
#if defined(__CUDA_ARCH__)
  float root;
  asm("sqrt.approx.ftz.f32 %0, %1;" : "=f"(root) : "f"(v));
  return root;
#else
  return sqrtf(v);
#endif
}

// How far from a voxel's centre a plane may pass for the voxel to be touched under thin coverage, and within what of that is doubt; times
// the normal. Units of the vertices turn the plane: that shows at a centre two voxels away.
struct ThinBand {
  float reach, band;
};
VOXELPIPE_HD ThinBand ThinBandOf(float most, float norm, float longest, float rounding, const FixedPlace& place) {
  const float turned = 24.0f * place.voxel * RoughSqrt(longest);
  return {fmaf(place.widening, norm, 0.5f * place.voxel * most), fmaf(place.plane_band, norm, rounding + turned)};
}

// The octants about `corner`, of those in question, that a triangle touches whose box reaches at most one voxel to each side of it.
template <bool kThin>
VOXELPIPE_HD Octants TouchedOctants(const int (&v)[3][3], const int (&corner)[3], uint32_t in_question,
                                    const FixedPlace& place) {
  Vec3f q[3];
  for (int i = 0; i < 3; ++i) {
    q[i] = {float(v[i][0] - corner[0]), float(v[i][1] - corner[1]), float(v[i][2] - corner[2])};
  }
  const Vec3f e[3] = {q[1] - q[0], q[2] - q[1], q[0] - q[2]};  // exact, and so is what follows but for products
  Vec3f n;
  n.x = fmaf(e[0].z, e[2].y, -(e[0].y * e[2].z));  // cross(e0, -e2)
  n.y = fmaf(e[0].x, e[2].z, -(e[0].z * e[2].x));
  n.z = fmaf(e[0].y, e[2].x, -(e[0].x * e[2].y));
  float longest = 0;  // squared
  for (int i = 0; i < 3; ++i) longest = fmaxf(longest, LengthSquared(e[i]));
  const float rounding = 0x1p-22f * longest;
  uint32_t touched = in_question;
  const uint32_t sides[3] = {SignMask(n.x), SignMask(n.y), SignMask(n.z)};
  const float ax = fabsf(n.x), ay = fabsf(n.y), az = fabsf(n.z);
  const float most = fmaxf(ax, fmaxf(ay, az)), norm = (ax + ay) + az;
  // What is certain stays above 0. Narrow for sure: kNarrowRatio, a little more, and what moving vertices by units does to the normal.
  float sure = most - fmaf(0.0042f, longest, place.noise);
  for (int i = 0; i < 3; ++i) {
    const CellEdge edge{e[i], {SignMask(e[i].x), SignMask(e[i].y), SignMask(e[i].z)}};
    TestEdge<0, 1>(edge, q[i], sides[2], rounding, place, touched, sure);
    TestEdge<1, 2>(edge, q[i], sides[0], rounding, place, touched, sure);
    TestEdge<2, 0>(edge, q[i], sides[1], rounding, place, touched, sure);
  }
  const float plane_rounding = 0x1p-20f * longest * place.voxel;
  const float at = -fmaf(n.x, q[0].x, fmaf(n.y, q[0].y, n.z * q[0].z));  // of the corner
  if constexpr (!kThin) {
    const float beyond = fmaf(-place.widening, norm, fabsf(at));
    sure = fminf(sure, fabsf(beyond) - fmaf(place.plane_band, norm, plane_rounding));
    const uint32_t side = ~SignMask(at);
    const uint32_t x = side ^ sides[0] ^ ~HalfOf(0), y = side ^ sides[1] ^ ~HalfOf(1), z = side ^ sides[2] ^ ~HalfOf(2);
    TakeOutIf(beyond, x & y, z, touched);
    return {touched, !(sure > 0)};
  } else {
    // The plane against each voxel's centre.
    const ThinBand thin = ThinBandOf(most, norm, longest, plane_rounding, place);
    const float half = 0.5f * place.voxel, hx = half * n.x, hy = half * n.y, hz = half * n.z;
    uint32_t out = 0, certain = 0;
    for (int i = 7; i >= 0; --i) {
      const float there = ((i & 4) != 0 ? at + hz : at - hz) + ((i & 2) != 0 ? hy : -hy) + ((i & 1) != 0 ? hx : -hx);
      const float within = thin.reach - fabsf(there);
      out = PushSign(out, within);
      certain = PushSign(certain, thin.band - fabsf(within));
    }
    // Only octants that the other tests leave can be in doubt.
    return {touched & ~out, !(sure > 0) || (touched & ~certain) != 0};
  }
}

// Under thin coverage, of a triangle whose box is one voxel or two side by side along one axis: the octants about its inner corner. Edges
// take nothing out there, since the triangle touches all of the box.
VOXELPIPE_HD Octants TouchedThinRun(const int (&v)[3][3], const FixedBox& box, const FixedPlace& place) {
  Vec3f q[3];
  for (int a = 0; a < 3; ++a) {
    const int centre = (box.first[a] << place.bits) + (1 << place.bits) / 2;  // of the first voxel
    for (int i = 0; i < 3; ++i) q[i][a] = float(v[i][a] - centre);
  }
  const Vec3f e0 = q[1] - q[0], e1 = q[2] - q[1], e2 = q[0] - q[2];
  Vec3f n;
  n.x = fmaf(e0.z, e2.y, -(e0.y * e2.z));
  n.y = fmaf(e0.x, e2.z, -(e0.z * e2.x));
  n.z = fmaf(e0.y, e2.x, -(e0.x * e2.y));
  const float longest = fmaxf(LengthSquared(e0), fmaxf(LengthSquared(e1), LengthSquared(e2)));
  const float ax = fabsf(n.x), ay = fabsf(n.y), az = fabsf(n.z);
  const float most = fmaxf(ax, fmaxf(ay, az)), norm = (ax + ay) + az;
  float sure = most - fmaf(0.0042f, longest, place.noise);
  uint32_t touched = 0;
  // A vertex is farther from the first centre than it would be from the corner: up to one and a half voxels.
  const ThinBand thin = ThinBandOf(most, norm, longest, 0x1p-19f * longest * place.voxel, place);
  const float at = -fmaf(n.x, q[0].x, fmaf(n.y, q[0].y, n.z * q[0].z));
  const float beyond = fabsf(at) - thin.reach;
  sure = fminf(sure, fabsf(beyond) - thin.band);
  if (!(beyond > 0)) touched = 1;
  const bool along_x = box.first[0] != box.last[0], along_y = box.first[1] != box.last[1];
  if (!along_x && !along_y && box.first[2] == box.last[2]) return {touched, !(sure > 0)};
  const float second = fabsf(fmaf(place.voxel, along_x ? n.x : along_y ? n.y : n.z, at)) - thin.reach;
  sure = fminf(sure, fabsf(second) - thin.band);
  if (!(second > 0)) touched |= along_x ? 0x02 : along_y ? 0x04 : 0x10;
  // A voxel that the triangle reaches by its widening alone, and hardly: roundings of the edges' tests may leave it out.
  const int w = int(place.widening), hardly = 1 << (place.bits - 13);
  int least[3], greatest[3];
  for (int i = 0; i < 3; ++i) {
    least[i] = Min(v[0][i], Min(v[1][i], v[2][i])) - w;
    greatest[i] = Max(v[0][i], Max(v[1][i], v[2][i])) + w;
  }
  const int from = along_x ? least[0] : along_y ? least[1] : least[2];
  const int upto = along_x ? greatest[0] : along_y ? greatest[1] : greatest[2];
  const bool near = ((from ^ (from + hardly)) | (upto ^ (upto - hardly))) >> place.bits != 0;
  return {touched, near || !(sure > 0)};
}

// Bounds of a coordinate u given t, about c - s*t: `outer` to each side at most, `inner` at least.
struct CellBound {
  float c, s, outer, inner;
};

// Between two bounds of one coordinate, outer and inner; local voxels.
struct CellSpan {
  float first_outer, first_inner, last_outer, last_inner;
};

// Of a number that is not close to 0, as all are whose inverse is used here; what that is off by is part of the band.
VOXELPIPE_HD float Reciprocal(float v) {
#if defined(__CUDA_ARCH__)
  float inverse;
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(inverse) : "f"(v));
  return inverse;
#else
  return 1.0f / v;
#endif
}

// Whole numbers of less than 22 bits as floats with this on top, in which their bits stand as those of an integer. Others stay as large as they are
// or nearly so. Roundings to such are additions on a device.
inline constexpr float kWhole = 0x1.8p23f;
VOXELPIPE_HD float WholeFrom(float v) {  // the least that is not less
#if defined(__CUDA_ARCH__)
  return __fadd_ru(v, kWhole);
#else
  return ceilf(v) + kWhole;
#endif
}
VOXELPIPE_HD float WholeUpto(float v) {  // the greatest that is not greater
#if defined(__CUDA_ARCH__)
  return __fadd_rd(v, kWhole);
#else
  return floorf(v) + kWhole;
#endif
}
VOXELPIPE_HD int IntOf(float whole) {
  int32_t bits;
  memcpy(&bits, &whole, sizeof bits);
  return bits - 0x4b400000;
}
VOXELPIPE_HD int CountOf(float first, float last) {  // of whole numbers from one to the other
  int32_t from, upto;
  memcpy(&from, &first, sizeof from);
  memcpy(&upto, &last, sizeof upto);
  return upto - from + 1;
}

// `count` bits of a word from one on; those beyond it are left out.
VOXELPIPE_HD uint32_t BitsFrom(uint32_t first, int count) {
#if defined(__CUDA_ARCH__)
  uint32_t bits;
  asm("bmsk.clamp.b32 %0, %1, %2;" : "=r"(bits) : "r"(first), "r"(count));
  return bits;
#else
  return uint32_t(((uint64_t{1} << count) - 1) << first);
#endif
}

// The bound |nu*u + nt*t - middle| <= half, where half is sure to within `band`. `none`: it bounds nothing; without a branch, as most do.
VOXELPIPE_HD CellBound SolveCell(bool none, float nu, float nt, float middle, float half, float band) {
  const float inverse = none ? 0 : Reciprocal(nu), length = fabsf(inverse), more = none ? 1e30f : 0;
  return {middle * inverse, nt * inverse, fmaf(half + band, length, more), fmaf(half - band, length, more)};
}

// An edge e through p, seen along an axis; as TestEdge. Where it is parallel to u it says no more than the box; its components are whole units of the
// fixed point.
VOXELPIPE_HD CellBound EdgeCells(float eu, float et, float pu, float pt, float area, float band, float rounding) {
  const float norm = fabsf(eu) + fabsf(et);
  const float middle = fmaf(-0.5f, (area + et) - eu, fmaf(et, pu, -(eu * pt)));
  return SolveCell(et == 0, et, -eu, middle, fmaf(0.5f + float(kNarrowWidening), norm, 0.5f * fabsf(area)),
                   fmaf(band, norm, rounding));
}

VOXELPIPE_HD void Narrow(const CellBound& b, float t, CellSpan& span) {
  const float c = fmaf(-b.s, t, b.c);
  span.first_outer = fmaxf(span.first_outer, c - b.outer);
  span.first_inner = fmaxf(span.first_inner, c - b.inner);
  span.last_outer = fminf(span.last_outer, c + b.outer);
  span.last_inner = fminf(span.last_inner, c + b.inner);
}

inline constexpr int kMostCells = 9;  // of a box along each axis that goes by rows here

// Takes rows of VisitCells to visit(y, z, x, count).
template <typename Visit>
class EachRow {
 public:
  VOXELPIPE_HD explicit EachRow(const Visit& visit) : visit_(visit) {}
  VOXELPIPE_HD void Layer(int z) { z_ = z; }
  VOXELPIPE_HD void Row(int y, int x, int count) { visit_(y, z_, x, count); }

 private:
  const Visit& visit_;
  int z_ = 0;
};

// Rows of a box of at most kMostCells voxels along each axis, within `begin` to `end` of the grid: to.Layer(z) before those of a layer, then
// to.Row(y, x, count), `count` voxels from x on, or none; y and z are counted from `begin`, x from the box's first voxel. False as soon as some voxel is not
// certain; rows already visited are right. `table` has room for kMostCells elements, `pitch` apart. Of the layers those from number `part` on, `parts`
// apart. `whole`: the triangle touches all of the box.
template <bool kThin, typename Rows>
VOXELPIPE_HD bool VisitCells(const int (&v)[3][3], const FixedBox& box, const int (&begin)[3], const int (&end)[3],
                             const FixedPlace& place, CellSpan* table, int pitch, bool whole, Rows&& to, int part = 0,
                             int parts = 1) {
  const float voxels = place.voxels;
  Vec3f q[3];
  for (int i = 0; i < 3; ++i) {
    q[i] = {float(v[i][0] - (box.first[0] << place.bits)) * voxels,
            float(v[i][1] - (box.first[1] << place.bits)) * voxels,
            float(v[i][2] - (box.first[2] << place.bits)) * voxels};
  }
  if (whole) q[1] = q[2] = q[0];  // a point bounds nothing: lanes of a warp go the same way
  const Vec3f e[3] = {q[1] - q[0], q[2] - q[1], q[0] - q[2]};  // exact
  Vec3f n;
  n.x = fmaf(e[0].z, e[2].y, -(e[0].y * e[2].z));
  n.y = fmaf(e[0].x, e[2].z, -(e[0].z * e[2].x));
  n.z = fmaf(e[0].y, e[2].x, -(e[0].x * e[2].y));
  const float ax = fabsf(n.x), ay = fabsf(n.y), az = fabsf(n.z);
  const float most = fmaxf(ax, fmaxf(ay, az)), norm = (ax + ay) + az;
  float longest = 0;
  for (int i = 0; i < 3; ++i) longest = fmaxf(longest, LengthSquared(e[i]));
  if (!whole && !(most > fmaf(0.0042f, longest, 0x1p-19f))) return false;  // perhaps not narrow
  // Rounding errors grow with the box: of products of two lengths, of three, and of the plane that moving vertices by units turns.
  const auto size =
      float(2 + Max(box.last[0] - box.first[0], Max(box.last[1] - box.first[1], box.last[2] - box.first[2])));
  const float band = fmaf(place.band, voxels, kMoreOfRows), rounding = 1.5e-6f * size * size;

  // The plane bounds x. Where x says nothing, neither does the plane if it is parallel to a second axis too: the box says it.
  CellBound plane{0, 0, 1e30f, 1e30f};
  float plane_sy = 0;
  if (ax > norm * 0x1p-26f) {
    const float middle = fmaf(-0.5f, (n.x + n.y) + n.z, fmaf(n.x, q[0].x, fmaf(n.y, q[0].y, n.z * q[0].z)));
    float half = (0.5f + float(kNarrowWidening)) * norm,
          unsure = fmaf(fmaf(place.plane_band, voxels, kMoreOfRows), norm, 4e-6f * size * size * size);
    if constexpr (kThin) {
      half = fmaf(float(kNarrowWidening), norm, 0.5f * most);
      unsure += 16.0f * voxels * size * sqrtf(longest);
    }
    plane = SolveCell(false, n.x, n.z, middle, half, unsure);
    plane_sy = n.y * Reciprocal(n.x);
  } else if (Min(ay, az) > norm * 0x1p-26f) {
    return false;
  }

  const int x_lo = begin[0] - box.first[0], x_hi = end[0] - box.first[0];
  const CellSpan box_x{float(x_lo), float(x_lo), float(x_hi - 1), float(x_hi - 1)};
  const int y_lo = begin[1] - box.first[1], y_hi = end[1] - box.first[1];
  {
    CellBound x_of_y[3];
    for (int i = 0; i < 3; ++i) x_of_y[i] = EdgeCells(e[i].x, e[i].y, q[i].x, q[i].y, n.z, band, rounding);
    CellSpan* next = table;
#if defined(__CUDA_ARCH__)
#pragma unroll 1  // there are few
#endif
    for (int y = y_lo; y < y_hi; ++y, next += pitch) {
      CellSpan span = box_x;
      for (int i = 0; i < 3; ++i) Narrow(x_of_y[i], float(y), span);
      *next = span;
    }
  }
  CellBound x_of_z[3], y_of_z[3];
  for (int i = 0; i < 3; ++i) {
    x_of_z[i] = EdgeCells(e[i].x, e[i].z, q[i].x, q[i].z, -n.y, band, rounding);
    y_of_z[i] = EdgeCells(e[i].y, e[i].z, q[i].y, q[i].z, n.x, band, rounding);
  }
  const int layers = end[2] - begin[2], z_lo = begin[2] - box.first[2];
  for (int k = part; k < layers; k += parts) {
    const auto z = float(z_lo + k);
    CellSpan rows{float(y_lo), float(y_lo), float(y_hi - 1), float(y_hi - 1)}, layer = box_x;
    for (int i = 0; i < 3; ++i) {
      Narrow(y_of_z[i], z, rows);
      Narrow(x_of_z[i], z, layer);
    }
    const float from_y = WholeFrom(rows.first_outer), upto_y = WholeUpto(rows.last_outer);
    if (from_y > upto_y) continue;
    // Certain where between the inner bounds lie the same whole numbers.
    float y = from_y - kWhole;
    if (y < rows.first_inner || upto_y - kWhole > rows.last_inner) return false;
    to.Layer(k);
    const float plane_c = fmaf(-plane.s, z, plane.c);
    int j = IntOf(from_y) - y_lo, last_j = IntOf(upto_y) - y_lo;
    const CellSpan* shared = table + j * pitch;
    do {
      const float c = fmaf(-plane_sy, y, plane_c);
      const float first = WholeFrom(fmaxf(fmaxf(shared->first_outer, layer.first_outer), c - plane.outer));
      const float last = WholeUpto(fminf(fminf(shared->last_outer, layer.last_outer), c + plane.outer));
      if (first <= last) {
        const float from = fmaxf(fmaxf(shared->first_inner, layer.first_inner), c - plane.inner);
        const float upto = fminf(fminf(shared->last_inner, layer.last_inner), c + plane.inner);
        // Without a branch, which would cost every row more: in doubt there are no voxels, and no more rows.
        const bool doubt = first - kWhole < from || last - kWhole > upto;
        last_j = doubt ? -1 : last_j;
        to.Row(j, IntOf(first), doubt ? 0 : CountOf(first, last));
      }
      y += 1;
      shared += pitch;
    } while (++j <= last_j);
    if (last_j < 0) return false;
  }
  return true;
}

}  // namespace voxelpipe::cuda
