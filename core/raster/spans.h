// The one definition of coverage: which voxels of a row a triangle covers.
//
// For a fixed layer z the tests of triangle_setup.h bound the rows y, and for a fixed row (y, z) they bound x from both
// sides, so the touched voxels of a row form one interval. Every rasterizer (tiles, rows, SIMD lanes, CUDA) calls this
// code or repeats its operations one by one, so all agree by construction.
#pragma once

#include "raster/triangle_setup.h"

namespace voxelpipe {

// Local coordinates, inclusive; empty if last < first.
template <typename Real>
struct Interval {
  Real first, last;
  VOXELPIPE_HD bool empty() const { return last < first; }
};

// Bounds in a layer z: its rows, integer valued, and the bounds of x that all its rows share.
template <typename Real>
struct Layer {
  Interval<Real> y;
  Interval<Real> x;  // not rounded
  Real plane_lo, plane_hi;
};

template <typename Real>
VOXELPIPE_HD Layer<Real> ComputeLayer(const SpanBounds<Real>& s, Real z) {
  Layer<Real> layer;
  Real y_first = s.first[1], y_last = s.last[1];
  for (int i = 0; i < 4; ++i) {
    const Real shift = s.y_of_z[i].s * z;
    y_first = Greater(y_first, s.y_of_z[i].lo - shift);
    y_last = Lesser(y_last, s.y_of_z[i].hi - shift);
  }
  layer.y = {Ceil(y_first), Floor(y_last)};
  layer.x = {s.first[0], s.last[0]};
  for (int i = 0; i < 3; ++i) {
    const Real shift = s.x_of_z[i].s * z;
    layer.x.first = Greater(layer.x.first, s.x_of_z[i].lo - shift);
    layer.x.last = Lesser(layer.x.last, s.x_of_z[i].hi - shift);
  }
  const Real shift = s.plane.s * z;
  layer.plane_lo = s.plane.lo - shift;
  layer.plane_hi = s.plane.hi - shift;
  return layer;
}

// In: a local row y of a layer, inside layer.y. Out: its touched voxels, integer valued.
template <typename Real>
VOXELPIPE_HD Interval<Real> ComputeRow(const SpanBounds<Real>& s, const Layer<Real>& layer, Real y) {
  Real first = layer.x.first, last = layer.x.last;
  for (int i = 0; i < 3; ++i) {
    const Real shift = s.x_of_y[i].s * y;
    first = Greater(first, s.x_of_y[i].lo - shift);
    last = Lesser(last, s.x_of_y[i].hi - shift);
  }
  const Real shift = s.plane_sy * y;
  first = Greater(first, layer.plane_lo - shift);
  last = Lesser(last, layer.plane_hi - shift);
  return {Ceil(first), Floor(last)};
}

// A box of voxels in grid coordinates, half open.
struct VoxelRange {
  int64_t begin[3] = {0, 0, 0}, end[3] = {0, 0, 0};
  VOXELPIPE_HD bool empty() const { return end[0] <= begin[0] || end[1] <= begin[1] || end[2] <= begin[2]; }
};

// The voxels of `within` that the triangle's box touches. Clamped in floating point before the conversion: processors
// convert values out of range differently.
VOXELPIPE_HD VoxelRange ClipToRange(const TriangleSetup& s, const VoxelRange& within) {
  VoxelRange r;
  for (int i = 0; i < 3; ++i) {
    const double lo = double(within.begin[i]), hi = double(within.end[i]);
    r.begin[i] = int64_t(Clamp(s.box_first[i], lo, hi));
    r.end[i] = int64_t(Clamp(s.box_last[i] + 1, lo, hi));
  }
  return r;
}

// ForEachRowSpan for one set-up. In: `range`, a result of ClipToRange.
template <typename Real, typename Visit>
VOXELPIPE_HD void ForEachRow(const SpanBounds<Real>& s, const Vec3d& base, const VoxelRange& range, Visit&& visit) {
  const double x_lo = double(range.begin[0]), x_hi = double(range.end[0]);
  const double y_lo = double(range.begin[1]), y_hi = double(range.end[1]);
  for (int64_t z = range.begin[2]; z < range.end[2]; ++z) {
    const Layer<Real> layer = ComputeLayer(s, Real(double(z) - base.z));
    if (layer.y.empty() || layer.x.empty()) continue;
    const int64_t y_begin = int64_t(Clamp(base.y + double(layer.y.first), y_lo, y_hi));
    const int64_t y_end = int64_t(Clamp((base.y + double(layer.y.last)) + 1, y_lo, y_hi));
    for (int64_t y = y_begin; y < y_end; ++y) {
      const Interval<Real> row = ComputeRow(s, layer, Real(double(y) - base.y));
      if (row.empty()) continue;
      const int64_t x_begin = int64_t(Clamp(base.x + double(row.first), x_lo, x_hi));
      const int64_t x_end = int64_t(Clamp((base.x + double(row.last)) + 1, x_lo, x_hi));
      if (x_begin < x_end) visit(y, z, x_begin, x_end);
    }
  }
}

// Calls visit(y, z, x_begin, x_end) in grid coordinates for each row of `within` that the triangle touches, z slowest;
// x_end is exclusive.
template <typename Visit>
VOXELPIPE_HD void ForEachRowSpan(const TriangleSetup& s, const VoxelRange& within, Visit&& visit) {
  const VoxelRange range = ClipToRange(s, within);
  if (range.empty()) return;
  if (s.span_class == SpanClass::kNarrow) return ForEachRow(s.narrow, s.base, range, visit);
  if (s.span_class == SpanClass::kWide) return ForEachRow(s.wide, s.base, range, visit);
  for (int64_t z = range.begin[2]; z < range.end[2]; ++z) {
    for (int64_t y = range.begin[1]; y < range.end[1]; ++y) visit(y, z, range.begin[0], range.end[0]);
  }
}

}  // namespace voxelpipe
