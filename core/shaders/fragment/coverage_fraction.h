// coverage_fraction: the area of the triangle in the voxel.
//
// Source: I. E. Sutherland and G. W. Hodgman, "Reentrant Polygon Clipping", CACM 17(1), 1974.
#pragma once

#include <cmath>

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// A convex polygon; a triangle clipped by six planes has at most nine corners.
struct ClipPolygon {
  static constexpr int kCapacity = 10;
  Vec3d corner[kCapacity];
  int count = 0;
};

// Keeps the half space sign * p[axis] <= sign * at.
VOXELPIPE_HD void ClipHalfSpace(ClipPolygon& polygon, int axis, double at, double sign) {
  ClipPolygon kept;
  for (int i = 0; i < polygon.count; ++i) {
    const Vec3d& a = polygon.corner[i];
    const Vec3d& b = polygon.corner[i + 1 < polygon.count ? i + 1 : 0];
    const double da = sign * (a[axis] - at), db = sign * (b[axis] - at);
    if (da <= 0 && kept.count < ClipPolygon::kCapacity) kept.corner[kept.count++] = a;
    if ((da < 0 && db > 0) || (da > 0 && db < 0)) {
      Vec3d cut = a + (b - a) * (da / (da - db));
      cut[axis] = at;  // exact, so that the other plane of this axis sees no rounding
      if (kept.count < ClipPolygon::kCapacity) kept.corner[kept.count++] = cut;
    }
  }
  polygon = kept;
}

// Area of the part of triangle (a, b, c) in the closed unit cube at `lo`, in double.
VOXELPIPE_HD double ClippedArea(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& lo) {
  ClipPolygon polygon;
  polygon.corner[0] = a - lo;  // local: cells far from the origin lose no digits
  polygon.corner[1] = b - lo;
  polygon.corner[2] = c - lo;
  polygon.count = 3;
  for (int plane = 0; plane < 6 && polygon.count > 0; ++plane) {
    ClipHalfSpace(polygon, plane / 2, plane % 2, plane % 2 == 0 ? -1.0 : 1.0);
  }
  Vec3d twice{0, 0, 0};
  for (int i = 2; i < polygon.count; ++i) {
    twice = twice + Cross(polygon.corner[i - 1] - polygon.corner[0], polygon.corner[i] - polygon.corner[0]);
  }
  return 0.5 * sqrt(Dot(twice, twice));
}

// True if the triangle lies in the plane of a face of the voxel and counts in the voxel on the face's other side: in
// the one behind the triangle, against its normal; at the grid's border in the one there is.
VOXELPIPE_HD bool CountsBeyondFace(const Vec3d& a, const Vec3d& b, const Vec3d& c, const int64_t voxel[3],
                                   const int64_t grid_dims[3]) {
  for (int axis = 0; axis < 3; ++axis) {
    const double at = a[axis], low = double(voxel[axis]);
    if (b[axis] != at || c[axis] != at || (at != low && at != low + 1)) continue;
    const double normal = Cross(b - a, c - a)[axis];
    const bool behind = at == low ? normal < 0 : normal > 0;
    const bool border = at == low ? voxel[axis] == 0 : voxel[axis] + 1 == grid_dims[axis];
    return !behind && !border;
  }
  return false;
}

// Output: f32, 1 component: the area of the triangle inside the closed voxel over the area of a voxel's face, both in
// index space. A plane parallel to a face that cuts the whole voxel gives 1; the maximum is sqrt(2) (the rectangle
// through two opposite edges). 0 for voxels that the triangle only touches or that the widening of the coverage test
// adds, and for degenerate triangles. An area in a face that two voxels share counts in one (CountsBeyondFace). Faces
// are unit squares of index space, also where the voxel's edges differ in length.
struct CoverageFractionShader : FragmentShaderTraits {
  static constexpr bool kIsFraction = true;
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    if (in.degenerate) return;
    const Vec3d* p = in.mesh->index_positions;
    const Vec3d lo{double(in.voxel[0]), double(in.voxel[1]), double(in.voxel[2])};
    const Vec3d &a = p[in.vertex[0]], &b = p[in.vertex[1]], &c = p[in.vertex[2]];
    if (CountsBeyondFace(a, b, c, in.voxel, in.mesh->grid_dims)) return;
    out.f[0] = float(ClippedArea(a, b, c, lo));
  }
};

}  // namespace voxelpipe
