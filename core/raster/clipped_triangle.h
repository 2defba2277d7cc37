// Clips a triangle to an axis-aligned box.
//
// Source: I. Sutherland and G. Hodgman, "Reentrant Polygon Clipping", CACM 17(1), 1974.
#pragma once

#include "base/host_device.h"
#include "base/vec.h"

namespace voxelpipe {

// Extents of a polygon along the axes, and its areas projected onto the planes orthogonal to them.
struct PolygonSize {
  Vec3d width{}, area{};
};

// A triangle clipped by at most six planes, each orthogonal to an axis.
class ClippedTriangle {
 public:
  VOXELPIPE_HD ClippedTriangle(const Vec3d& a, const Vec3d& b, const Vec3d& c) : points_{a, b, c}, count_(3) {}

  // Keeps the half space side * p[axis] >= side * plane; `side` is 1 or -1.
  VOXELPIPE_HD void Clip(int axis, double plane, double side) {
    Vec3d out[kMaxPoints];
    int count = 0;
    for (int i = 0; i < count_ && count + 2 <= kMaxPoints; ++i) {
      const Vec3d &p = points_[i], &q = points_[i + 1 < count_ ? i + 1 : 0];
      const double dp = side * (p[axis] - plane), dq = side * (q[axis] - plane);
      if (dp >= 0) out[count++] = p;
      if ((dp < 0) != (dq < 0)) out[count++] = p + (q - p) * (dp / (dp - dq));
    }
    for (int i = 0; i < count; ++i) points_[i] = out[i];
    count_ = count;
  }

  // Clips to the box from the origin to `far`.
  VOXELPIPE_HD void ClipTo(const Vec3d& far) {
    for (int axis = 0; axis < 3; ++axis) {
      Clip(axis, 0, 1);
      Clip(axis, far[axis], -1);
    }
  }

  // Zeros if nothing is left.
  VOXELPIPE_HD PolygonSize Size() const {
    PolygonSize size;
    if (count_ == 0) return size;
    Vec3d lo = points_[0], hi = points_[0], normal{};
    for (int i = 1; i < count_; ++i) {
      for (int a = 0; a < 3; ++a) {
        lo[a] = Min(lo[a], points_[i][a]);
        hi[a] = Max(hi[a], points_[i][a]);
      }
      if (i + 1 < count_) normal = normal + Cross(points_[i] - points_[0], points_[i + 1] - points_[0]);
    }
    size.width = hi - lo;
    for (int a = 0; a < 3; ++a) size.area[a] = 0.5 * Abs(normal[a]);
    return size;
  }

 private:
  static constexpr int kMaxPoints = 12;
  Vec3d points_[kMaxPoints];
  int count_;
};

}  // namespace voxelpipe
