// The one definition of coverage: which voxels of a row a triangle touches.
//
// For fixed (y, z) every axis test of triangle_setup.h is linear in x, so the touched voxels of the row form one interval.
// Every schedule (tiles, plain rows, CUDA) takes coverage from here, so all agree by construction.
#pragma once

#include "raster/triangle_setup.h"

namespace voxelpipe {

// Local voxel coordinates, inclusive, integer valued; empty if last < first.
struct RowSpan {
  double first = 0, last = -1;
  VOXELPIPE_HD bool empty() const { return last < first; }
};

// In: a set-up and a local row (y, z), both inside [first, last] of the set-up. Out: the touched voxels of that row.
VOXELPIPE_HD RowSpan ComputeRowSpan(const TriangleSetup& s, double y, double z) {
  double first = s.first.x, last = s.last.x;
  for (int i = 0; i < s.slab_count; ++i) {
    const AxisSlab& slab = s.slabs[i];
    const double rest = slab.ny * y + slab.nz * z;
    const double lo = slab.lo - rest, hi = slab.hi - rest;
    if (slab.inv_nx == 0) {
      if (lo > 0 || hi < 0) return {};
      continue;
    }
    const double x0 = lo * slab.inv_nx, x1 = hi * slab.inv_nx;
    first = Max(first, Min(x0, x1));
    last = Min(last, Max(x0, x1));
  }
  return {ceil(first), floor(last)};
}

// A box of voxels in grid coordinates, half open.
struct VoxelRange {
  int64_t begin[3] = {0, 0, 0}, end[3] = {0, 0, 0};
  VOXELPIPE_HD bool empty() const { return end[0] <= begin[0] || end[1] <= begin[1] || end[2] <= begin[2]; }
};

// The voxels of `within` that the triangle's box touches. Clamped in floating point before the conversion: out of
// range, processors differ.
VOXELPIPE_HD VoxelRange ClipToRange(const TriangleSetup& s, const VoxelRange& within) {
  VoxelRange r;
  for (int i = 0; i < 3; ++i) {
    const double lo = double(within.begin[i]), hi = double(within.end[i]);
    r.begin[i] = int64_t(Clamp(s.base[i] + s.first[i], lo, hi));
    r.end[i] = int64_t(Clamp((s.base[i] + s.last[i]) + 1, lo, hi));
  }
  return r;
}

// Calls visit(y, z, x_begin, x_end) in grid coordinates for each row of `within` that the triangle touches, z slowest;
// x_end is exclusive.
template <typename Visit>
VOXELPIPE_HD void ForEachRowSpan(const TriangleSetup& s, const VoxelRange& within, Visit&& visit) {
  const VoxelRange range = ClipToRange(s, within);
  if (range.empty()) return;
  const double lo = double(range.begin[0]), hi = double(range.end[0]);
  for (int64_t z = range.begin[2]; z < range.end[2]; ++z) {
    for (int64_t y = range.begin[1]; y < range.end[1]; ++y) {
      const RowSpan span = ComputeRowSpan(s, double(y) - s.base.y, double(z) - s.base.z);
      if (span.empty()) continue;
      const int64_t x_begin = int64_t(Clamp(s.base.x + span.first, lo, hi));
      const int64_t x_end = int64_t(Clamp((s.base.x + span.last) + 1, lo, hi));
      if (x_begin < x_end) visit(y, z, x_begin, x_end);
    }
  }
}

// Barycentric coordinates of voxel (x,y,z)'s centre (grid coordinates): projected onto the plane along its normal,
// negative ones set to 0, renormalized; 1/3 each for a degenerate triangle. Index space, evaluated in double.
VOXELPIPE_HD Vec3f Barycentrics(const TriangleSetup& s, int64_t x, int64_t y, int64_t z) {
  const float third = 1.0f / 3.0f;
  if (s.degenerate) return {third, third, third};
  const Vec3d centre{(double(x) - s.base.x) + 0.5, (double(y) - s.base.y) + 0.5, (double(z) - s.base.z) + 0.5};
  const Vec3d d = (centre - s.v0) * s.normal_scale;
  const Vec3d f1 = s.e1 * s.normal_scale, f2 = s.e2 * s.normal_scale;
  const double nn = Dot(s.normal, s.normal);
  double b1 = Dot(Cross(d, f2), s.normal) / nn;
  double b2 = Dot(Cross(f1, d), s.normal) / nn;
  double b0 = (1 - b1) - b2;
  b0 = Max(b0, 0.0);
  b1 = Max(b1, 0.0);
  b2 = Max(b2, 0.0);
  const double sum = (b0 + b1) + b2;
  return {float(b0 / sum), float(b1 / sum), float(b2 / sum)};
}

}  // namespace voxelpipe
