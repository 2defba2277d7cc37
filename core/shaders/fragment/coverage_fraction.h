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

// Output: f32, 1 component: the area of the triangle inside the closed voxel over the area of a voxel's face, both in
// index space. A plane parallel to a face that cuts the whole voxel gives 1; the maximum is sqrt(2) (the rectangle
// through two opposite edges). 0 for voxels that the triangle only touches or that the widening of the coverage test
// adds, and for degenerate triangles. An area in a face shared by two voxels counts in both. Faces are unit squares of
// index space, also where the voxel's edges differ in length.
struct CoverageFractionShader : FragmentShaderTraits {
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    if (in.degenerate) return;
    const Vec3d* p = in.mesh->index_positions;
    const Vec3d lo{double(in.voxel[0]), double(in.voxel[1]), double(in.voxel[2])};
    out.f[0] = float(ClippedArea(p[in.vertex[0]], p[in.vertex[1]], p[in.vertex[2]], lo));
  }
};

}  // namespace voxelpipe
