// The voxels of a triangle within eight layers of eight rows, the size of a grid block: its layers there and their
// rows. Used by block_raster.cuh, which writes a grid block by block. In the code a grid block is called a piece. No
// host-only includes.
#pragma once

#include "cuda/traversal/triangle_walk.cuh"

namespace voxelpipe::cuda {

inline constexpr int kPieceEdge = 8;

// A layer of a triangle within a grid block: its rows `begin` to `end` of the eight, and the terms they share.
struct PieceLayer {
  double x_first, x_last, plane_lo, plane_hi;
  uint32_t triangle;  // index among the triangles that the warp draws at a time
  uint8_t z, begin, end;
};

template <typename Real>
__device__ inline Layer<Real> LayerOf(const SpanBounds<Real>& bounds, Real z, PieceLayer& out) {
  const Layer<Real> layer = ComputeLayer(bounds, z);
  out.x_first = double(layer.x.first);
  out.x_last = double(layer.x.last);
  out.plane_lo = double(layer.plane_lo);
  out.plane_hi = double(layer.plane_hi);
  return layer;
}
// Computes a layer z of the grid for a grid block whose first row is y. False if the triangle has no rows among the
// block's `rows` rows.
__device__ inline bool FindLayer(const SharedSetup& s, int y, int z, PieceLayer& out, int rows = kPieceEdge) {
  if (z < s.begin[2] || z >= s.end[2]) return false;
  int begin = s.begin[1], end = s.end[1];
  if (s.span_class == SpanClass::kNarrow) {
    const Layer<float> layer = LayerOf(s.narrow, float(z - s.cell[2]), out);
    if (layer.y.empty() || layer.x.empty()) return false;
    begin = max(begin, s.cell[1] + int(layer.y.first));
    end = min(end, s.cell[1] + int(layer.y.last) + 1);
  } else if (s.span_class == SpanClass::kWide) {
    const Layer<double> layer = LayerOf(s.wide, double(z) - s.base.z, out);
    if (layer.y.empty() || layer.x.empty()) return false;
    const double lo = double(begin), hi = double(end);
    begin = int(Clamp(s.base.y + double(layer.y.first), lo, hi));
    end = int(Clamp((s.base.y + double(layer.y.last)) + 1, lo, hi));
  }
  begin = max(begin - y, 0);
  end = min(end - y, rows);
  if (begin >= end) return false;
  out.begin = uint8_t(begin);
  out.end = uint8_t(end);
  return true;
}

template <typename Real>
__device__ inline Interval<Real> RowOf(const SpanBounds<Real>& bounds, const PieceLayer& l, Real y) {
  Layer<Real> layer;
  layer.x = {Real(l.x_first), Real(l.x_last)};
  layer.plane_lo = Real(l.plane_lo);
  layer.plane_hi = Real(l.plane_hi);
  return ComputeRow(bounds, layer, y);
}
// Row y of a layer that contains it, in grid coordinates. False if the triangle does not touch it.
__device__ inline bool FindRow(const SharedSetup& s, const PieceLayer& layer, int y, int& x_begin, int& x_end) {
  x_begin = s.begin[0];
  x_end = s.end[0];
  if (s.span_class == SpanClass::kNarrow) {
    const Interval<float> row = RowOf(s.narrow, layer, float(y - s.cell[1]));
    if (row.empty()) return false;
    x_begin = max(x_begin, s.cell[0] + int(row.first));
    x_end = min(x_end, s.cell[0] + int(row.last) + 1);
  } else if (s.span_class == SpanClass::kWide) {
    const Interval<double> row = RowOf(s.wide, layer, double(y) - s.base.y);
    if (row.empty()) return false;
    const double lo = double(x_begin), hi = double(x_end);
    x_begin = int(Clamp(s.base.x + double(row.first), lo, hi));
    x_end = int(Clamp((s.base.x + double(row.last)) + 1, lo, hi));
  }
  return x_begin < x_end;
}

template <typename Real>
__device__ inline SpanBounds<Real> BoundsOfRows(const SpanBounds<Real>& bounds) {
  SpanBounds<Real> rows;
  for (int i = 0; i < 3; ++i) rows.x_of_y[i] = bounds.x_of_y[i];
  rows.plane_sy = bounds.plane_sy;
  return rows;
}

// True if the plane alone bounds the layer's rows. Bounds of x are a product and a sum, each rounded once, so they are
// monotonic: rows in between have bounds in between.
__device__ inline bool IsPlaneAlone(const SharedSetup& s, const PieceLayer& layer, int y) {
  if (s.span_class != SpanClass::kWide || double(s.cell[0]) != s.base.x) return false;
  const double first = double(y + int(layer.begin)) - s.base.y, last = double(y + int(layer.end) - 1) - s.base.y;
  double lo = layer.x_first, hi = layer.x_last;
  for (int i = 0; i < 3; ++i) {
    const Bound<double>& bound = s.wide.x_of_y[i];
    const double here = bound.s * first, there = bound.s * last;
    lo = Greater(lo, Greater(bound.lo - here, bound.lo - there));
    hi = Lesser(hi, Lesser(bound.hi - here, bound.hi - there));
  }
  const double here = s.wide.plane_sy * first, there = s.wide.plane_sy * last;
  return lo <= Lesser(layer.plane_lo - here, layer.plane_lo - there) &&
         hi >= Greater(layer.plane_hi - here, layer.plane_hi - there);
}

// Rounds up and down, saturating to 32 bits.
__device__ inline int IntAbove(double v) {
#if defined(__CUDA_ARCH__)
  return __double2int_ru(v);
#else
  return int(Clamp(ceil(v), -0x1p31, 0x1p31 - 1));
#endif
}
__device__ inline int IntBelow(double v) {
#if defined(__CUDA_ARCH__)
  return __double2int_rd(v);
#else
  return int(Clamp(floor(v), -0x1p31, 0x1p31 - 1));
#endif
}

// Bounds of a triangle's rows other than the plane: its box along x, relative to voxel `cell`.
struct RowClip {
  int cell, least, most;

  RowClip() = default;
  __device__ explicit RowClip(const SharedSetup& s)
      : cell(s.cell[0]), least(s.begin[0] - s.cell[0]), most(s.end[0] - s.cell[0]) {}
};

// A row of a layer for which IsPlaneAlone holds. `shift`: the plane's slope times the row's distance from the setup's
// base. Empty if x_begin >= x_end.
__device__ inline void RowOfPlane(const RowClip& clip, const PieceLayer& layer, double shift, int& x_begin,
                                  int& x_end) {
  const int first = IntAbove(layer.plane_lo - shift), last = IntBelow(layer.plane_hi - shift);
  x_begin = clip.cell + min(max(first, clip.least), clip.most);
  x_end = clip.cell + min(max(last, clip.least - 1), clip.most - 1) + 1;
}

// Calls set(row of the grid block, x_begin, x_end) for the rows of a layer for which IsPlaneAlone holds.
template <typename Set>
__device__ inline void ForEachRowOfPlane(const SharedSetup& s, const PieceLayer& layer, int y, Set&& set) {
  const RowClip clip(s);
  const double slope = s.wide.plane_sy;
  double local = double(y + int(layer.begin)) - s.base.y;
  for (int row = int(layer.begin); row < int(layer.end); ++row, local += 1) {
    int x_begin, x_end;
    RowOfPlane(clip, layer, slope * local, x_begin, x_end);
    set(row, x_begin, x_end);
  }
}

// The same for any layer, with rows as in FindRow.
template <typename Set>
__device__ inline void ForEachRowOf(const SharedSetup& s, const PieceLayer& layer, int y, Set&& set) {
  const int x_lo = s.begin[0], x_hi = s.end[0];
  if (s.span_class == SpanClass::kNarrow) {
    const SpanBounds<float> bounds = BoundsOfRows(s.narrow);
    const int from_x = s.cell[0], from_y = s.cell[1];
    for (int row = int(layer.begin); row < int(layer.end); ++row) {
      const Interval<float> x = RowOf(bounds, layer, float(y + row - from_y));
      if (!x.empty()) set(row, max(x_lo, from_x + int(x.first)), min(x_hi, from_x + int(x.last) + 1));
    }
  } else if (s.span_class == SpanClass::kWide) {
    const SpanBounds<double> bounds = BoundsOfRows(s.wide);
    const double from_x = s.base.x, from_y = s.base.y, lo = double(x_lo), hi = double(x_hi);
    for (int row = int(layer.begin); row < int(layer.end); ++row) {
      const Interval<double> x = RowOf(bounds, layer, double(y + row) - from_y);
      if (!x.empty()) set(row, int(Clamp(from_x + x.first, lo, hi)), int(Clamp((from_x + x.last) + 1, lo, hi)));
    }
  } else {
    for (int row = int(layer.begin); row < int(layer.end); ++row) set(row, x_lo, x_hi);
  }
}

}  // namespace voxelpipe::cuda
