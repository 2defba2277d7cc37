// Crossings of a triangle with the lines along x through the voxel centres, for the parity and nonzero fills.
//
// Source: the even-odd rule (M. Shimrat, "Algorithm 112: Position of point relative to polygon", 1962), evaluated per
// edge so that two triangles that share an edge agree on it whatever the rounding: a mesh whose edges are all shared by
// an even number of triangles has an even number of crossings in every column.
#pragma once

#include <cmath>
#include <cstdint>

#include "base/vec.h"
#include "raster/triangle_plane.h"

namespace voxelpipe {

// True if the edge a-b, seen along x, is crossed by the half line from (py, pz) towards +z: exactly one end has y <=
// py, and the edge passes above pz there. Evaluated in double with the ends in lexicographic (y, z) order, never in a
// triangle's local frame, so that neighbours agree.
VOXELPIPE_HD bool EdgeCrossesAbove(const Vec3d& a, const Vec3d& b, double py, double pz) {
  const bool a_first = a.y < b.y || (a.y == b.y && a.z <= b.z);
  const Vec3d& p = a_first ? a : b;
  const Vec3d& q = a_first ? b : a;
  if ((p.y <= py) == (q.y <= py)) return false;
  return (q.y - p.y) * (pz - p.z) - (q.z - p.z) * (py - p.y) < 0;
}

// True if the line along x through (py, pz) crosses the triangle (index space).
VOXELPIPE_HD bool LineCrosses(const Vec3d& a, const Vec3d& b, const Vec3d& c, double py, double pz) {
  return (EdgeCrossesAbove(a, b, py, pz) != EdgeCrossesAbove(b, c, py, pz)) != EdgeCrossesAbove(c, a, py, pz);
}

// True if the crossing falls: y falls along a-b-c-a on the one edge that the half line of EdgeCrossesAbove crosses. In:
// a triangle for which LineCrosses is true.
//
// Exactly one edge is crossed: py separates the ends of two edges or of none, and LineCrosses is true if an odd number
// of these edges pass above pz. In a closed, consistently oriented mesh every column has as many rising as falling
// crossings; the sum of the signs before a point is its winding number.
VOXELPIPE_HD bool CrossingFalls(const Vec3d& a, const Vec3d& b, const Vec3d& c, double py, double pz) {
  if (EdgeCrossesAbove(a, b, py, pz)) return a.y > b.y;
  return EdgeCrossesAbove(b, c, py, pz) ? b.y > c.y : c.y > a.y;
}

// The x (index space) at which that line crosses the triangle, clamped to the triangle's x range.
VOXELPIPE_HD double CrossingX(const TrianglePlane& s, const Vec3d& a, const Vec3d& b, const Vec3d& c, double py,
                              double pz) {
  const double lo = Min(a.x, Min(b.x, c.x)), hi = Max(a.x, Max(b.x, c.x));
  const double dy = (py - s.base.y) - s.v0.y, dz = (pz - s.base.z) - s.v0.z;
  if (s.normal.x == 0) {  // edge-on or degenerate: the line meets it only by rounding; the nearest point of an edge
    const double length = s.e1.y * s.e1.y + s.e1.z * s.e1.z;
    const double t = length > 0 ? (dy * s.e1.y + dz * s.e1.z) / length : 0.0;
    return Clamp(s.base.x + (s.v0.x + t * s.e1.x), lo, hi);
  }
  const double x = s.v0.x - (s.normal.y * dy + s.normal.z * dz) / s.normal.x;
  return Clamp(s.base.x + x, lo, hi);
}

// Number of voxels of a row of nx whose centre lies before x: those that a crossing at x toggles.
VOXELPIPE_HD int64_t CentresBefore(double x, int64_t nx) {
  return int64_t(Clamp(ceil(x - 0.5), 0.0, double(nx)));
}

}  // namespace voxelpipe
