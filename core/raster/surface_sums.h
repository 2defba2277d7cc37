// What is summed over a mesh's triangles to estimate what they touch of a grid (pipeline/surface.h).
#pragma once

#include <cstdint>

#include "base/host_device.h"
#include "base/vec.h"
#include "grid/index_space.h"
#include "raster/clipped_triangle.h"
#include "raster/exact_math.h"
#include "raster/triangle_setup.h"

namespace voxelpipe {

// World units. Triangles count with a weight: see WeighInWindow.
struct SurfaceSums {
  double triangles = 0;
  Vec3d area{};      // projected onto the planes orthogonal to x, y, z
  Vec3d dominant{};  // the same, of each triangle only the largest of the three
  Vec3d width{};     // extents of each triangle's box
  // Signed, between the triangles and the centre of the mesh's box: the enclosed one where the mesh is closed.
  double volume = 0;
};

// The grid, where it is known before a triangle is looked at.
struct GridWindow {
  Vec3d origin{}, voxel_size{1, 1, 1};
  Vec3d dims{};  // voxels; 0 where the grid is not known

  VOXELPIPE_HD bool known() const { return dims.x > 0; }
};

// What a triangle adds to SurfaceSums.
struct WeighedTriangle {
  double weight = 0;  // of the triangle itself; the sizes are multiplied by it
  PolygonSize size;
};

// A triangle's part in the window. On average over all placements of the lattice it touches 1 + its widths + its areas
// voxels. One that lies between two layers of voxels touches both, and none touches more than its box has: the weight
// says how many times the average it is. 0 beyond the window.
VOXELPIPE_HD WeighedTriangle WeighInWindow(const GridWindow& window, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  constexpr double kTie = kNarrowWidening;  // voxels: coverage is widened by so much at most
  constexpr double kFlat = 1e-3;            // voxels: as thin as this along an axis is to lie in one plane of it
  WeighedTriangle out;
  const Vec3d p = WorldToIndex(window.origin, window.voxel_size, a);
  const Vec3d q = WorldToIndex(window.origin, window.voxel_size, b);
  const Vec3d r = WorldToIndex(window.origin, window.voxel_size, c);
  double box = 1, layers = 1;
  bool inside = true;
  for (int i = 0; i < 3; ++i) {
    const double lo = Min(p[i], Min(q[i], r[i])), hi = Max(p[i], Max(q[i], r[i]));
    const double first = Max(0.0, Ceil(lo - kTie) - 1), last = Min(window.dims[i] - 1, Floor(hi + kTie));
    if (!(first <= last)) return out;
    box *= last - first + 1;
    if (hi - lo < kFlat) layers *= last - first + 1;
    inside = inside && lo >= 0 && hi <= window.dims[i];
  }
  ClippedTriangle part(p, q, r);
  for (int i = 0; i < 3 && !inside; ++i) {
    part.Clip(i, 0, 1);
    part.Clip(i, window.dims[i], -1);
  }
  out.size = part.Size();
  const Vec3d &w = out.size.width, &s = out.size.area, &h = window.voxel_size;
  out.weight = Min(layers, box / (1 + w.x + w.y + w.z + s.x + s.y + s.z));
  out.size.width = Vec3d{w.x * h.x, w.y * h.y, w.z * h.z} * out.weight;
  out.size.area = Vec3d{s.x * h.y * h.z, s.y * h.z * h.x, s.z * h.x * h.y} * out.weight;
  return out;
}

// The same of a triangle as it is, where the grid is not known.
VOXELPIPE_HD WeighedTriangle WeighWhole(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  WeighedTriangle out;
  const Vec3d normal = Cross(b - a, c - a);
  for (int i = 0; i < 3; ++i) {
    out.size.width[i] = Max(a[i], Max(b[i], c[i])) - Min(a[i], Min(b[i], c[i]));
    out.size.area[i] = 0.5 * Abs(normal[i]);
  }
  out.weight = 1;
  return out;
}

}  // namespace voxelpipe
