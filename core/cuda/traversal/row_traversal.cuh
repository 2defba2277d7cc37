// Enumerates the rows of voxels of a triangle by one thread or by many: the device's schedules of raster/spans.h.
#pragma once

#include "raster/spans.h"

namespace voxelpipe::cuda {

// A half-open box of voxels in 32-bit coordinates.
struct Box32 {
  int begin[3], end[3];
  __device__ int rows() const { return (end[1] - begin[1]) * (end[2] - begin[2]); }
};

// Number of rows of a range, saturated to UINT32_MAX.
__device__ inline uint32_t RowCount(const VoxelRange& r) {
  const uint64_t rows = uint64_t(r.end[1] - r.begin[1]) * uint64_t(r.end[2] - r.begin[2]);
  return rows < UINT32_MAX ? uint32_t(rows) : UINT32_MAX;
}

// True if one thread may process the triangle alone: not of the wide class, and few rows.
__device__ inline bool IsForOneThread(const TriangleSetup& s, const VoxelRange& clipped, uint32_t most_rows) {
  return s.span_class != SpanClass::kWide && RowCount(clipped) <= most_rows;
}

// Enumerates all rows of a narrow triangle within `range`, by one thread: visit(y, z, x_begin, x_end) in grid
// coordinates. Such a triangle is at most about 34 voxels long, so 32 bits suffice.
template <typename Visit>
__device__ inline void WalkNarrow(const SpanBounds<float>& s, const int (&base)[3], const Box32& range, Visit&& visit) {
  for (int z = range.begin[2]; z < range.end[2]; ++z) {
    const Layer<float> layer = ComputeLayer(s, float(z - base[2]));
    if (layer.y.empty() || layer.x.empty()) continue;
    const int y_end = min(range.end[1], base[1] + int(layer.y.last) + 1);
    for (int y = max(range.begin[1], base[1] + int(layer.y.first)); y < y_end; ++y) {
      const Interval<float> row = ComputeRow(s, layer, float(y - base[1]));
      if (row.empty()) continue;
      const int x_begin = max(range.begin[0], base[0] + int(row.first));
      const int x_end = min(range.end[0], base[0] + int(row.last) + 1);
      if (x_begin < x_end) visit(y, z, x_begin, x_end);
    }
  }
}

// Enumerates all rows of a narrow or run-class triangle, by one thread. `range`: the non-empty result of ClipToRange.
template <typename Visit>
__device__ inline void WalkRows(const TriangleSetup& s, const VoxelRange& range, Visit&& visit) {
  Box32 box;
  for (int i = 0; i < 3; ++i) {
    box.begin[i] = int(range.begin[i]);
    box.end[i] = int(range.end[i]);
  }
  if (s.span_class == SpanClass::kRun) {
    for (int z = box.begin[2]; z < box.end[2]; ++z) {
      for (int y = box.begin[1]; y < box.end[1]; ++y) visit(y, z, box.begin[0], box.end[0]);
    }
    return;
  }
  const int base[3] = {int(s.base.x), int(s.base.y), int(s.base.z)};
  WalkNarrow(s.narrow, base, box, visit);
}

// One row of a triangle. False if the triangle does not touch it within `range`.
template <typename Real>
__device__ inline bool RowOf(const SpanBounds<Real>& s, const Vec3d& base, const VoxelRange& range, int64_t y,
                             int64_t z, int64_t& x_begin, int64_t& x_end) {
  const Layer<Real> layer = ComputeLayer(s, Real(double(z) - base.z));
  if (layer.y.empty() || layer.x.empty()) return false;
  const Real local = Real(double(y) - base.y);
  if (local < layer.y.first || local > layer.y.last) return false;
  const Interval<Real> row = ComputeRow(s, layer, local);
  if (row.empty()) return false;
  const double lo = double(range.begin[0]), hi = double(range.end[0]);
  x_begin = int64_t(Clamp(base.x + double(row.first), lo, hi));
  x_end = int64_t(Clamp((base.x + double(row.last)) + 1, lo, hi));
  return x_begin < x_end;
}

// Row number `row` of `range` (y fastest), a result of ClipToRange. False if the triangle does not touch it.
__device__ inline bool RowSpan(const TriangleSetup& s, const VoxelRange& range, uint64_t row, int64_t& y, int64_t& z,
                               int64_t& x_begin, int64_t& x_end) {
  const uint64_t ny = uint64_t(range.end[1] - range.begin[1]);
  y = range.begin[1] + int64_t(row % ny);
  z = range.begin[2] + int64_t(row / ny);
  if (s.span_class == SpanClass::kRun) {
    x_begin = range.begin[0];
    x_end = range.end[0];
    return true;
  }
  if (s.span_class == SpanClass::kNarrow) return RowOf(s.narrow, s.base, range, y, z, x_begin, x_end);
  return RowOf(s.wide, s.base, range, y, z, x_begin, x_end);
}

// Exclusive prefix sum over the warp; `total` receives the sum of all lanes. All 32 lanes call it.
__device__ inline uint32_t WarpExclusiveSum(uint32_t value, uint32_t& total) {
  const unsigned lane = threadIdx.x % 32;
  uint32_t sum = value;
  for (unsigned step = 1; step < 32; step *= 2) {
    const uint32_t below = __shfl_up_sync(~0u, sum, step);
    if (lane >= step) sum += below;
  }
  total = __shfl_sync(~0u, sum, 31);
  return sum - value;
}

// The lane that owns item `item`, given the exclusive prefix sum `before` of the lanes' item counts: binary search over
// the first kLanes lanes, a power of two. Lanes without items are never found for valid items. All 32 lanes call it.
template <int kLanes = 32>
__device__ inline int LaneOfItem(uint32_t before, uint32_t item) {
  int found = 0;
#pragma unroll
  for (int step = kLanes / 2; step > 0; step /= 2) {
    if (__shfl_sync(~0u, before, found + step) <= item) found += step;
  }
  return found;
}

// Reserves `count` elements per lane in an array whose length is `counter`. Returns the lane's first index. One atomic
// per warp. All 32 lanes call it.
__device__ inline uint64_t WarpAllocate(uint64_t* counter, uint32_t count) {
  uint32_t total;
  const uint32_t before = WarpExclusiveSum(count, total);
  unsigned long long first = 0;
  if (threadIdx.x % 32 == 0 && total > 0) {
    first = atomicAdd(reinterpret_cast<unsigned long long*>(counter), static_cast<unsigned long long>(total));
  }
  return __shfl_sync(~0u, first, 0) + before;
}

// The same for a block of kThreads threads, with one atomic per block: an atomic that returns costs about 3 ns, which
// matters if millions of threads append. All threads call it. `shared` has kThreads / 32 + 1 words, which are free
// after the next barrier.
template <int kThreads>
__device__ inline uint64_t BlockAllocate(uint64_t* counter, uint32_t count, unsigned long long* shared) {
  constexpr int kWarps = kThreads / 32;
  uint32_t total;
  const uint32_t before = WarpExclusiveSum(count, total);
  const unsigned warp = threadIdx.x / 32;
  if (threadIdx.x % 32 == 0) shared[warp] = total;
  __syncthreads();
  if (threadIdx.x == 0) {
    unsigned long long sum = 0;
    for (int w = 0; w < kWarps; ++w) {
      const unsigned long long here = shared[w];
      shared[w] = sum;
      sum += here;
    }
    shared[kWarps] = sum == 0 ? 0 : atomicAdd(reinterpret_cast<unsigned long long*>(counter), sum);
  }
  __syncthreads();
  return shared[kWarps] + shared[warp] + before;
}

}  // namespace voxelpipe::cuda
