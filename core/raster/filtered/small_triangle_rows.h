// Small triangles whose boxes exceed 2x2x2 voxels (small_triangle_tests.h), by rows as in raster/spans.h. Each bound is
// computed twice: an outer one for voxels grown by the widening of narrow triangles plus an error band, an inner one
// for the widening minus the band. If both give the same voxels, so does every bound in between, and the result is
// certain. No host-only includes.
#pragma once

#include "raster/filtered/small_triangle_tests.h"

namespace voxelpipe {

// Voxels: additional width of the band, since boxes are up to 9 voxels large.
inline constexpr float kMoreOfRows = 1e-5f;

// Bounds of a coordinate u for given t, around c - s*t: `outer` is the maximum half-width, `inner` the minimum.
struct CellBound {
  float c, s, outer, inner;
};

// Interval of a coordinate in local voxels, with outer and inner bounds.
struct CellSpan {
  float first_outer, first_inner, last_outer, last_inner;
};

// Rounding by a magic number: after adding kToInteger, integers of less than 22 bits are in the low bits of the float.
// Larger values keep their magnitude approximately. On a device, rounding up or down is then a single addition.
inline constexpr float kToInteger = 0x1.8p23f;
VOXELPIPE_HD float WholeFrom(float v) {  // the smallest integer >= v
#if defined(__CUDA_ARCH__)
  return __fadd_ru(v, kToInteger);
#else
  return ceilf(v) + kToInteger;
#endif
}
VOXELPIPE_HD float WholeUpto(float v) {  // the largest integer <= v
#if defined(__CUDA_ARCH__)
  return __fadd_rd(v, kToInteger);
#else
  return floorf(v) + kToInteger;
#endif
}
VOXELPIPE_HD int32_t WholeBits(float whole) {
  int32_t bits;
  memcpy(&bits, &whole, sizeof bits);
  return bits;
}
VOXELPIPE_HD int IntOf(float whole) {
  return WholeBits(whole) - 0x4b400000;
}
VOXELPIPE_HD int CountOf(float first, float last) {  // number of integers in [first, last]
  return WholeBits(last) - WholeBits(first) + 1;
}

// A word with `count` bits set from bit `first` on; bits past its end are dropped.
VOXELPIPE_HD uint32_t BitsFrom(uint32_t first, int count) {
#if defined(__CUDA_ARCH__)
  uint32_t bits;
  asm("bmsk.clamp.b32 %0, %1, %2;" : "=r"(bits) : "r"(first), "r"(count));
  return bits;
#else
  return uint32_t(((uint64_t{1} << count) - 1) << first);
#endif
}

// Solves |nu*u + nt*t - middle| <= half for u, where `half` has an error of at most `band`. `none`: no bound.
// Branch-free, since the bound usually exists.
VOXELPIPE_HD CellBound SolveCell(bool none, float nu, float nt, float middle, float half, float band) {
  const float inverse = none ? 0 : Reciprocal(nu), length = fabsf(inverse), more = none ? 1e30f : 0;
  return {middle * inverse, nt * inverse, fmaf(half + band, length, more), fmaf(half - band, length, more)};
}

// The bound by edge e through p, projected along an axis, as in EdgeTest. An edge parallel to u adds nothing to the
// box; its components are whole units of the fixed point, so the comparison with 0 is exact.
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

inline constexpr int kMaxCells = 9;  // maximum extent of a box along each axis for this method

// Adapts the row interface of VisitCells to visit(y, z, x, count).
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

// Enumerates the rows of a triangle whose box has at most kMaxCells voxels along each axis, clipped to `begin` to `end`
// of the grid. Calls to.Layer(z) before the rows of a layer, then to.Row(y, x, count) for `count` >= 0 voxels from x
// on. y and z are relative to `begin`, x to the box's first voxel. Returns false at the first uncertain voxel; the rows
// visited before are correct. `table`: scratch for kMaxCells elements, `pitch` apart. Processes layers part, part +
// parts, ... `whole`: the triangle touches its whole box.
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
  if (whole) q[1] = q[2] = q[0];  // a point sets no bounds, and lanes of a warp do not diverge
  const Vec3f e[3] = {q[1] - q[0], q[2] - q[1], q[0] - q[2]};  // exact
  Vec3f n;
  n.x = fmaf(e[0].z, e[2].y, -(e[0].y * e[2].z));
  n.y = fmaf(e[0].x, e[2].z, -(e[0].z * e[2].x));
  n.z = fmaf(e[0].y, e[2].x, -(e[0].x * e[2].y));
  const float ax = fabsf(n.x), ay = fabsf(n.y), az = fabsf(n.z);
  const float most = fmaxf(ax, fmaxf(ay, az)), norm = (ax + ay) + az;
  float longest = 0;
  for (int i = 0; i < 3; ++i) longest = fmaxf(longest, LengthSquared(e[i]));
  if (!whole && !(most > fmaf(0.0042f, longest, 0x1p-19f))) return false;  // may not be narrow
  // Rounding errors grow with the box: those of products of two lengths, of three, and the rotation of the plane by the
  // quantization of vertices.
  const auto size =
      float(2 + Max(box.last[0] - box.first[0], Max(box.last[1] - box.first[1], box.last[2] - box.first[2])));
  const float band = fmaf(place.band, voxels, kMoreOfRows), rounding = 1.5e-6f * size * size;

  // The plane bounds x. If it is parallel to x it bounds nothing here; if it is then parallel to a second axis too, the
  // box already implies its bound.
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
#pragma unroll 1  // few iterations
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
    // Certain if the inner bounds contain the same integers.
    float y = from_y - kToInteger;
    if (y < rows.first_inner || upto_y - kToInteger > rows.last_inner) return false;
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
        // Branch-free, because a branch would cost every row more: an uncertain row has no voxels and ends the loop.
        const bool doubt = first - kToInteger < from || last - kToInteger > upto;
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

}  // namespace voxelpipe
