// Parts of measure.cpp: the voxels that one triangle touches, on average over all positions of the grid.
#pragma once

#include <algorithm>

#include "host_mesh/measure_cells.h"
#include "raster/clipped_triangle.h"
#include "raster/tiles.h"

namespace voxelpipe {

inline constexpr double kFlat = 1e-3;  // voxels: a triangle thinner than this along an axis lies in one plane

// The voxels that one triangle touches, on average.
struct Touch {
  Box box;  // voxels
  PolygonSize part;
  double voxels = 0;     // of the box
  double fragments = 0;  // of conservative coverage
  double rows = 0;
};

inline bool TouchOf(const Triangle& t, const Vec3d& lo, const Vec3d& hi, const GridSpec& grid, Touch& out) {
  if (!VoxelsOf(lo, hi, grid, out.box)) return false;
  out.voxels = Count(out.box);
  bool inside = true;
  for (size_t i = 0; i < 3; ++i) {
    inside = inside && lo[int(i)] >= 0 && hi[int(i)] <= double(grid.dims[i]);
  }
  if (inside) {
    const Vec3d normal = Cross(t.b - t.a, t.c - t.a);
    out.part.width = hi - lo;
    for (int i = 0; i < 3; ++i) out.part.area[i] = 0.5 * std::abs(normal[i]);
  } else {
    ClippedTriangle clipped(t.a, t.b, t.c);
    clipped.ClipTo({double(grid.dims[0]), double(grid.dims[1]), double(grid.dims[2])});
    out.part = clipped.Size();
  }
  const Vec3d &w = out.part.width, &a = out.part.area;
  double planes[3];  // two where it lies between voxels
  for (size_t i = 0; i < 3; ++i) {
    planes[i] = hi[int(i)] - lo[int(i)] < kFlat ? double(out.box[i].second - out.box[i].first + 1) : 1;
  }
  const double average = (1 + w.x + w.y + w.z + a.x + a.y + a.z) * planes[0] * planes[1] * planes[2];
  out.fragments = std::min(out.voxels, average);
  const double box_rows =
      double(out.box[1].second - out.box[1].first + 1) * double(out.box[2].second - out.box[2].first + 1);
  const double rows = std::min(box_rows, (1 + w.y + w.z + a.x) * planes[1] * planes[2]);
  out.rows = std::min(out.fragments, rows + out.fragments / double(TileDim(0)));
  return true;
}

inline double PairsOf(const Touch& touch) {
  double tiles = 1, average = 1, planes = 1;
  for (size_t i = 0; i < 3; ++i) {
    const int64_t dim = TileDim(int(i));
    const double along = double(touch.box[i].second / dim - touch.box[i].first / dim + 1);
    tiles *= along;
    // A triangle in a plane between tiles touches the tiles on both sides.
    if (touch.part.width[int(i)] < kFlat) planes *= along;
    average += touch.part.width[int(i)] / double(dim) +
               touch.part.area[int(i)] / double(TileDim((int(i) + 1) % 3) * TileDim((int(i) + 2) % 3));
  }
  return tiles <= 8 ? tiles : std::min(tiles, 1.1 * average * planes);
}

}  // namespace voxelpipe
