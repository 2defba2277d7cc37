// Decides which voxels small triangles touch, by integers and a few float tests: a floating-point filter with exact
// fallback (J. R. Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997,
// describes such filters). Where the filter is certain its answer is that of raster/spans.h.
//
// Vertices are in fixed point, and bounding boxes are known (fixed_point.h). Let w be the widening of narrow triangles
// (raster/triangle_setup.h).
//
// Boxes of at most two voxels along each axis: up to 2x2x2 voxels ("octants" in the code) around an inner corner. By
// the separating-axis theorem the triangle touches all of them except those that one of ten tests excludes. A plane
// through an edge and parallel to an axis that leaves the corner outside by more than w excludes the two octants that
// it points to; the triangle's own plane excludes the one behind it. The exact test of the narrow class is the test for
// a voxel grown by w, up to its rounding errors. Let the band be the sum of those and of the quantization error. If no
// test comes closer to w than the band, the triangle touches the same octants for every growth within the band, so both
// answers agree.
//
// Under conservative coverage, three of the tests suffice if the box is two voxels along two axes and one along the
// third. The triangle lies within that one layer, so it touches what its projection along the third axis touches; the
// sides of the box and three edges decide that. If all of these are farther from a change of the decision than the
// widest band, the triangle touches each remaining voxel even if it is grown by that much less than w. Then none of the
// other tests excludes one, whatever its rounding errors.
//
// Larger boxes: small_triangle_rows.h.
//
// Uncertain cases, and triangles that may be of the wide class, are left to the exact code that all schedules share.
#pragma once

#include "raster/filtered/fixed_point.h"

namespace voxelpipe {

// A mask with all bits set if the sign bit of v is set, else 0.
VOXELPIPE_HD uint32_t SignMask(float v) {
  int32_t bits;
  memcpy(&bits, &v, sizeof bits);
  return uint32_t(bits >> 31);
}

struct Octants {
  uint32_t touched;  // bit x + 2y + 4z; certain unless `doubtful`
  bool doubtful;
};

// Mask of the octants on the upper side along an axis.
VOXELPIPE_HD constexpr uint32_t HalfOf(int axis) {
  return axis == 0 ? 0xaa : axis == 1 ? 0xcc : 0xf0;
}

// Clears the bits of `a & b` in `octants` if v > 0. On a device this is one predicated instruction instead of a select.
VOXELPIPE_HD void TakeOutIf(float v, uint32_t a, uint32_t b, uint32_t& octants) {
#if defined(__CUDA_ARCH__)
  asm("{ .reg .pred p; setp.gt.f32 p, %1, 0f00000000; @p lop3.b32 %0, %0, %2, %3, 0x70; }"
      : "+r"(octants)
      : "f"(v), "r"(a), "r"(b));
#else
  if (v > 0) octants &= ~(a & b);
#endif
}

// v, with its sign flipped if the sign bit of `by` is set.
VOXELPIPE_HD float TurnSign(float v, uint32_t by) {
  uint32_t bits;
  memcpy(&bits, &v, sizeof bits);
  bits ^= by & 0x80000000u;
  memcpy(&v, &bits, sizeof v);
  return v;
}

// Shifts `bits` left by one and inserts the sign bit of v.
VOXELPIPE_HD uint32_t PushSign(uint32_t bits, float v) {
#if defined(__CUDA_ARCH__)
  return __funnelshift_l(__float_as_uint(v), bits, 1);
#else
  return bits << 1 | (SignMask(v) & 1);
#endif
}

// The test of one edge, projected along an axis onto the plane of the other two, u and t; the edge passes through p.
// Excludes the octants beyond the edge, on the side away from the triangle. The other end of the separating axis, at
// the opposite vertex, needs no test: the other edges and the box exclude the same octants.
struct EdgeTest {
  uint32_t half_u, half_t;  // masks of the octants on the upper side along u and t
  uint32_t side;            // all bits set if the projected triangle's area is negative
  float widening, band;
  float rounding;  // bound of the rounding errors

  // Lowers `sure` to the distance of the corner from a change of the decision, minus the error bound, scaled by the
  // edge's length: positive if the test is certain.
  VOXELPIPE_HD void TakeOut(float eu, float et, float pu, float pt, uint32_t& touched, float& sure) const {
    const float norm = fabsf(eu) + fabsf(et);
    const float beyond = fmaf(-widening, norm, TurnSign(fmaf(eu, pt, -(et * pu)), side));
    sure = fminf(sure, fabsf(beyond) - fmaf(band, norm, rounding));
    TakeOutIf(beyond, side ^ SignMask(et) ^ half_u, side ^ SignMask(eu) ^ ~half_t, touched);
  }
};

VOXELPIPE_HD float LengthSquared(const Vec3f& e) {
  return fmaf(e.x, e.x, fmaf(e.y, e.y, e.z * e.z));
}

// Square root of a number that is 0 or at least 1, with a relative error of some 1e-6, which the band includes.
VOXELPIPE_HD float RoughSqrt(float v) {
#if defined(__CUDA_ARCH__)
  float root;
  asm("sqrt.approx.ftz.f32 %0, %1;" : "=f"(root) : "f"(v));
  return root;
#else
  return sqrtf(v);
#endif
}

// 1 / v with a relative error of 2^-22, which the bands include. v must not be close to 0, which holds for all uses
// here.
VOXELPIPE_HD float Reciprocal(float v) {
#if defined(__CUDA_ARCH__)
  float inverse;
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(inverse) : "f"(v));
  return inverse;
#else
  return 1.0f / v;
#endif
}

// Thin coverage: maximum distance of the plane from the centre of a touched voxel, and the half-width of the uncertain
// band around it, both scaled by the normal. The quantization of vertices rotates the plane, which matters at a centre
// up to two voxels away.
struct ThinBand {
  float reach, band;
};
VOXELPIPE_HD ThinBand ThinBandOf(float most, float norm, float longest, float rounding, const FixedPlace& place) {
  const float turned = 24.0f * place.voxel * RoughSqrt(longest);
  return {fmaf(place.widening, norm, 0.5f * place.voxel * most), fmaf(place.plane_band, norm, rounding + turned)};
}

// Coordinates of a triangle's corners along an axis, relative to a voxel corner, and of its edges: exact.
struct AlongAxis {
  float p[3], e[3];

  VOXELPIPE_HD AlongAxis(const int (&v)[3], int corner) {
    for (int i = 0; i < 3; ++i) p[i] = float(v[i] - corner);
    for (int i = 0; i < 3; ++i) e[i] = p[(i + 1) % 3] - p[i];
  }
};
// Twice the signed area of the triangle projected onto the plane of two axes.
VOXELPIPE_HD float AreaOf(const AlongAxis& u, const AlongAxis& t) {
  return fmaf(t.e[0], u.e[2], -(u.e[0] * t.e[2]));
}
VOXELPIPE_HD void TestEdges(const EdgeTest& test, const AlongAxis& u, const AlongAxis& t, uint32_t& touched,
                            float& sure) {
  for (int i = 0; i < 3; ++i) test.TakeOut(u.e[i], t.e[i], u.p[i], t.p[i], touched, sure);
}

// A triangle is certainly narrow if the largest component of its normal exceeds this value: kNarrowRatio with a margin,
// plus the change of the normal by quantization. `longest`: squared length of its longest edge.
VOXELPIPE_HD float NarrowFrom(float longest, const FixedPlace& place) {
  return fmaf(0.0042f, longest, place.noise);
}

// The octants in `in_question` that a triangle touches, for a box of at most two voxels along each axis.
template <bool kThin>
VOXELPIPE_HD Octants TouchedOctants(const int (&v)[3][3], const FixedBox& box, uint32_t in_question,
                                    const FixedPlace& place) {
  const auto along = [&](int a) { return AlongAxis({v[0][a], v[1][a], v[2][a]}, (box.first[a] + 1) << place.bits); };
  const AlongAxis x = along(0), y = along(1), z = along(2);
  const Vec3f n{AreaOf(y, z), AreaOf(z, x), AreaOf(x, y)};
  float longest = 0;  // squared
  for (int i = 0; i < 3; ++i) longest = fmaxf(longest, LengthSquared({x.e[i], y.e[i], z.e[i]}));
  const float rounding = 0x1p-22f * longest;
  uint32_t touched = in_question;
  const float ax = fabsf(n.x), ay = fabsf(n.y), az = fabsf(n.z);
  const float most = fmaxf(ax, fmaxf(ay, az)), norm = (ax + ay) + az;
  // Positive while all tests are certain.
  float sure = most - NarrowFrom(longest, place);
  const auto test = [&](int u, int t, float area) {
    return EdgeTest{HalfOf(u), HalfOf(t), SignMask(area), place.widening, place.band, rounding};
  };
  TestEdges(test(0, 1, n.z), x, y, touched, sure);
  TestEdges(test(1, 2, n.x), y, z, touched, sure);
  TestEdges(test(2, 0, n.y), z, x, touched, sure);
  const float at = -fmaf(n.x, x.p[0], fmaf(n.y, y.p[0], n.z * z.p[0]));  // signed distance of the corner
  const float plane_rounding = 0x1p-20f * longest * place.voxel;
  if constexpr (!kThin) {
    const float beyond = fmaf(-place.widening, norm, fabsf(at));
    sure = fminf(sure, fabsf(beyond) - fmaf(place.plane_band, norm, plane_rounding));
    const uint32_t side = ~SignMask(at);
    const uint32_t behind_x = side ^ SignMask(n.x) ^ ~HalfOf(0), behind_y = side ^ SignMask(n.y) ^ ~HalfOf(1);
    TakeOutIf(beyond, behind_x & behind_y, side ^ SignMask(n.z) ^ ~HalfOf(2), touched);
    return {touched, !(sure > 0)};
  } else {
    // Tests the plane against each voxel's centre.
    const ThinBand thin = ThinBandOf(most, norm, longest, plane_rounding, place);
    const float half = 0.5f * place.voxel, hx = half * n.x, hy = half * n.y, hz = half * n.z;
    uint32_t out = 0, certain = 0;
    for (int i = 7; i >= 0; --i) {
      const float there = ((i & 4) != 0 ? at + hz : at - hz) + ((i & 2) != 0 ? hy : -hy) + ((i & 1) != 0 ? hx : -hx);
      const float within = thin.reach - fabsf(there);
      out = PushSign(out, within);
      certain = PushSign(certain, thin.band - fabsf(within));
    }
    // Only octants that the other tests keep can be uncertain.
    return {touched & ~out, !(sure > 0) || (touched & ~certain) != 0};
  }
}

// The same under conservative coverage for a box of two voxels along two or three axes. Faster if few of a warp's boxes
// have three such axes, slower if many do. More slim triangles are uncertain.
VOXELPIPE_HD Octants TouchedQuickly(const int (&v)[3][3], const FixedBox& box, uint32_t in_question,
                                    const FixedPlace& place) {
  const auto along = [&](auto&& of) {
    return AlongAxis({of(v[0]), of(v[1]), of(v[2])}, (of(box.first) + 1) << place.bits);
  };
  // Two axes along which the box is two voxels.
  const bool along_x = box.first[0] != box.last[0], along_z = box.first[2] != box.last[2];
  const AlongAxis u = along([&](const int(&a)[3]) { return along_x ? a[0] : a[1]; });
  const AlongAxis t = along([&](const int(&a)[3]) { return along_z ? a[2] : a[1]; });
  const uint32_t half_u = along_x ? HalfOf(0) : HalfOf(1), half_t = along_z ? HalfOf(2) : HalfOf(1);
  const auto extent = float(box.extent);
  // Upper bound of the squared length of an edge.
  const float longest = 3 * extent * extent, rounding = 0x1p-22f * longest;
  const float area = AreaOf(u, t);
  const uint32_t side = SignMask(area);
  uint32_t touched = in_question;
  float sure = 0x1p100f;  // larger than any certainty of a test
  TestEdges({half_u, half_t, side, place.widening, place.plane_band, rounding}, u, t, touched, sure);
  const float narrow = NarrowFrom(longest, place);
  const bool is_cube = in_question == 0xff;
  float greatest = fabsf(area);
  if (is_cube || !(greatest > narrow)) {
    const AlongAxis k = along([&](const int(&a)[3]) { return along_x ? along_z ? a[1] : a[2] : a[0]; });
    const uint32_t half_k = half_u ^ half_t ^ (HalfOf(0) ^ HalfOf(1) ^ HalfOf(2));
    const float area_tk = AreaOf(t, k), area_ku = AreaOf(k, u);  // with `area`: the normal or its opposite
    const uint32_t side_tk = SignMask(area_tk), side_ku = SignMask(area_ku);
    TestEdges({half_t, half_k, side_tk, place.widening, place.band, rounding}, t, k, touched, sure);
    TestEdges({half_k, half_u, side_ku, place.widening, place.band, rounding}, k, u, touched, sure);
    const float norm = (fabsf(area_tk) + fabsf(area_ku)) + greatest;
    greatest = fmaxf(greatest, fmaxf(fabsf(area_tk), fabsf(area_ku)));
    // Signed distance of the corner from the plane.
    const float at = -fmaf(area_tk, u.p[0], fmaf(area_ku, t.p[0], area * k.p[0]));
    const float beyond = fmaf(-place.widening, norm, fabsf(at));
    sure = fminf(sure, fabsf(beyond) - fmaf(place.plane_band, norm, 0x1p-20f * longest * place.voxel));
    const uint32_t behind = ~SignMask(at);
    TakeOutIf(beyond, (behind ^ side_tk ^ ~half_u) & (behind ^ side_ku ^ ~half_t), behind ^ side ^ ~half_k, touched);
  }
  const bool clear = is_cube || box.beyond >= place.clear;
  return {touched, !(fminf(sure, greatest - narrow) > 0) || !clear};
}

// Thin coverage, for a triangle of the run class (box of one voxel, or of two along one axis): the touched octants
// around the inner corner of its box. The edge tests exclude nothing, since the triangle touches its whole box.
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
  float sure = most - NarrowFrom(longest, place);
  uint32_t touched = 0;
  // Vertices are up to one and a half voxels from the first centre, farther than from the corner.
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
  // Uncertain if the triangle barely reaches a voxel, and only by its widening: rounding errors of the edge tests may
  // exclude it.
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

}  // namespace voxelpipe
