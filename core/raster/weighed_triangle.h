// What one triangle adds to the sums over a mesh (raster/surface_sums.h).
#pragma once

#include "base/host_device.h"
#include "base/vec.h"
#include "raster/clipped_triangle.h"
#include "raster/exact_math.h"
#include "raster/surface_sums.h"
#include "raster/triangle_setup.h"

namespace voxelpipe {

// What a triangle adds to SurfaceSums.
struct WeighedTriangle {
  double weight = 0;  // of the triangle itself; the sizes are multiplied by it
  PolygonSize size;
  int axis = 0;  // axis along which the triangle's projected area, in voxels, is largest
};

// Weighs triangles: by the window of the grid, if it is known. Made once for all triangles of a mesh.
class TriangleScale {
 public:
  VOXELPIPE_HD explicit TriangleScale(const GridWindow& window)
      : window_(window), inverse_{1 / window.voxel_size.x, 1 / window.voxel_size.y, 1 / window.voxel_size.z} {}

  VOXELPIPE_HD WeighedTriangle Weigh(const Vec3d& a, const Vec3d& b, const Vec3d& c) const {
    WeighedTriangle out = window_.known() ? InWindow(ToIndex(a), ToIndex(b), ToIndex(c)) : Whole(a, b, c);
    const Vec3d &s = out.size.area, &h = window_.voxel_size;
    const double x = s.x * h.x, y = s.y * h.y, z = s.z * h.z;  // areas in voxels times one common factor
    out.axis = x >= y ? (x >= z ? 0 : 2) : (y >= z ? 1 : 2);
    return out;
  }

 private:
  VOXELPIPE_HD Vec3d ToIndex(const Vec3d& p) const {
    const Vec3d& o = window_.origin;
    return {(p.x - o.x) * inverse_.x, (p.y - o.y) * inverse_.y, (p.z - o.z) * inverse_.z};
  }

  // The unweighted triangle, if the grid is not known.
  VOXELPIPE_HD static WeighedTriangle Whole(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    WeighedTriangle out;
    const Vec3d normal = Cross(b - a, c - a);
    for (int i = 0; i < 3; ++i) {
      out.size.width[i] = Max(a[i], Max(b[i], c[i])) - Min(a[i], Min(b[i], c[i]));
      out.size.area[i] = 0.5 * Abs(normal[i]);
    }
    out.weight = 1;
    return out;
  }

  // The triangle's share in the window. It touches about weight * (1 + sum of widths + sum of areas) voxels. Widths
  // count the planes between voxels that the box crosses; averaged over all positions of the grid, that is the length
  // of the box. The areas are scaled with the widths. So a triangle in the grid's own planes and corners counts what it
  // touches there, and one between two layers of voxels touches both. The weight is limited so that no triangle touches
  // more voxels than its box. Zeros outside the window. In: vertices in voxels from the grid's first corner.
  VOXELPIPE_HD WeighedTriangle InWindow(const Vec3d& p, const Vec3d& q, const Vec3d& r) const {
    constexpr double kTie = kNarrowWidening;  // voxels: the widening of coverage is at most this
    constexpr double kFlat = 1e-3;            // voxels: a box thinner than this along an axis lies in one plane
    WeighedTriangle out;
    double box = 1, layers = 1;
    Vec3d planes{}, more{1, 1, 1};  // planes that the box crosses, and their ratio to its width
    bool inside = true;
    for (int i = 0; i < 3; ++i) {
      const double lo = Min(p[i], Min(q[i], r[i])), hi = Max(p[i], Max(q[i], r[i]));
      const double first = Max(0.0, Ceil(lo - kTie) - 1), last = Min(window_.dims[i] - 1, Floor(hi + kTie));
      if (!(first <= last)) return out;
      box *= last - first + 1;
      inside = inside && lo >= 0 && hi <= window_.dims[i];
      if (hi - lo < kFlat) {
        layers *= last - first + 1;
      } else {
        planes[i] = last - first;
        more[i] = planes[i] / (hi - lo);
      }
    }
    if (inside) {
      out.size = Whole(p, q, r).size;
      const Vec3d& s = out.size.area;
      out.size = {planes, {s.x * more.y * more.z, s.y * more.z * more.x, s.z * more.x * more.y}};
    } else {
      ClippedTriangle part(p, q, r);
      part.ClipTo(window_.dims);
      out.size = part.Size();
    }
    const Vec3d &w = out.size.width, &s = out.size.area, &h = window_.voxel_size;
    out.weight = Min(layers, box / (1 + w.x + w.y + w.z + s.x + s.y + s.z));
    out.size.width = Vec3d{w.x * h.x, w.y * h.y, w.z * h.z} * out.weight;
    out.size.area = Vec3d{s.x * h.y * h.z, s.y * h.z * h.x, s.z * h.x * h.y} * out.weight;
    return out;
  }

  GridWindow window_;
  Vec3d inverse_;
};

}  // namespace voxelpipe
