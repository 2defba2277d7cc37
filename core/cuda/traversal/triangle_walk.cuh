// Kernels that enumerate the rows of voxels of all triangles and pass them to an operation, which sets bits, counts or
// emits fragments.
//
// Work is divided by triangle size. The first kernel looks at bounding boxes only: a triangle whose box is a row of
// voxels is done at once (the run class of raster/triangle_setup.h), others go to one of two queues. The second kernel
// processes small triangles, one thread each. The third processes the rest: lanes of a warp set up one triangle each in
// shared memory, then the warp shares the rows of each. The largest are shared by all warps, in a fourth kernel.
//
// An operation has
//   Begin(t), Row(y, z, x_begin, x_end), End(t)     rows of a triangle that one thread processes
//   SharedRow(t, y, z, x_begin, x_end)              rows of a triangle that several threads share
//   Finish()                                        per thread at the end of a kernel, with the warp converged
//   repeats()                                       true if the queues are filled already, by an earlier operation
// No host-only includes: NVRTC compiles them too.
#pragma once

#include "cuda/primitives/views.h"
#include "cuda/primitives/voxel_code.h"
#include "cuda/traversal/row_traversal.cuh"

namespace voxelpipe::cuda {

inline constexpr int kRunThreads = 256, kSmallThreads = 128, kRestThreads = 128;
inline constexpr int kSetupsOfWarp = 16, kSetupsOfBlock = 32;  // in shared memory, of WalkRest and WalkLarge
inline constexpr int kRowsOfRun = 32, kRowsOfThread = 12;
inline constexpr uint64_t kRowsOfWarp = 8192;  // the maximum for one warp; all warps share larger triangles

struct WalkArgs {
  GridView grid;  // rows outside its slab are skipped
  Coverage coverage{};
  const uint32_t* triangles = nullptr;
  const Vec3d* positions = nullptr;  // index space
  const VertexCode* codes = nullptr;
  uint64_t triangle_count = 0;
  // Queues of deferred triangles, each with capacity for all. Small triangles with at most two rows along y and along z
  // are queued from the front of small_queue, others from the back: warps diverge less if their triangles are alike.
  uint32_t *small_queue = nullptr, *rest_queue = nullptr, *large_queue = nullptr;
  uint64_t* queued =
      nullptr;  // lengths: rest, large, small with at most two rows per axis, other small; 0 before the first kernel
};

// The grid, whose slab clips the triangle, and the coverage of a triangle. The same for all triangles here; in a batch
// they depend on the item (batch_views.h).
__device__ inline const GridView& GridOf(const WalkArgs& args, uint32_t) {
  return args.grid;
}
__device__ inline Coverage CoverageOf(const WalkArgs& args, uint32_t) {
  return args.coverage;
}

struct Corners {
  uint32_t v[3];
};
__device__ inline Corners LoadCorners(const uint32_t* triangles, uint64_t t) {
  const uint32_t* v = triangles + 3 * t;
  return {{v[0], v[1], v[2]}};
}
__device__ inline CodedBox LoadBox(const VertexCode* codes, const Corners& c) {
  return DecodeBox(codes[c.v[0]], codes[c.v[1]], codes[c.v[2]]);
}

// Clips a box; false if it is empty.
__device__ inline bool Clip(const CodedBox& box, const Box32& within, Box32& clipped) {
  bool empty = false;
  for (int i = 0; i < 3; ++i) {
    clipped.begin[i] = max(box.first[i], within.begin[i]);
    clipped.end[i] = min(box.last[i] + 1, within.end[i]);
    empty = empty || clipped.begin[i] >= clipped.end[i];
  }
  return !empty;
}

__device__ inline Box32 SlabBox(const GridView& grid) {
  return {{0, 0, int(grid.slab_begin)}, {int(grid.dims[0]), int(grid.dims[1]), int(grid.slab_end)}};
}

// True for the run class: the triangle touches all voxels of its box.
__device__ inline bool IsRun(const CodedBox& box, Coverage coverage) {
  const int single = (box.first[0] == box.last[0]) + (box.first[1] == box.last[1]) + (box.first[2] == box.last[2]);
  return coverage == Coverage::kConservative && single >= 2;
}

// SetUpTriangle for a narrow triangle with a known box, under conservative or thin coverage. False if it is not narrow.
__device__ inline bool SetUpNarrow(const Vec3d* positions, Coverage coverage, const Corners& c, const CodedBox& box,
                                   SpanBounds<float>& bounds) {
  using namespace setup_internal;
  const Vec3d base{double(box.base[0]), double(box.base[1]), double(box.base[2])};
  Shape<float> shape;
  if (!NarrowShape(positions[c.v[0]], positions[c.v[1]], positions[c.v[2]], base, shape)) return false;
  shape.half = HalfSizes(coverage, shape.normal);
  for (int i = 0; i < 3; ++i) {
    bounds.first[i] = float(box.first[i] - box.base[i]);
    bounds.last[i] = float(box.last[i] - box.base[i]);
  }
  BoundShape(shape, coverage, bounds);
  return true;
}

// A triangle setup in shared memory.
struct SharedSetup {
  union {
    SpanBounds<float> narrow;
    SpanBounds<double> wide;
  };
  Vec3d base;
  int begin[3], end[3];  // its box, clipped to the requested range
  int cell[3];           // integer base of a narrow triangle; of others if it is in range
  uint32_t ny;
  float one_over_ny;
  uint32_t triangle;
  SpanClass span_class;
};

// A TriangleSetup with references to its destination: a copy would go through local memory.
struct SetupInPlace {
  SpanBounds<float>& narrow;
  SpanBounds<double>& wide;
  SpanClass span_class;
  Vec3d base, box_first, box_last;
};

// The part of a setup that one of kBoundsParts adjacent lanes computes.
struct SetupInParts {
  BoundsPart<float> narrow;
  BoundsPart<double> wide;
  SpanClass span_class;
  Vec3d base, box_first, box_last;
};

// Computes a shared setup except its bounds, and stores it if `writes`. Returns the number of its rows within `within`.
template <typename Setup>
__device__ inline uint64_t FinishShared(const Setup& s, const VoxelRange& within, uint32_t t, bool writes,
                                        SharedSetup& shared) {
  int begin[3], end[3];
  bool empty = false;
  for (int i = 0; i < 3; ++i) {  // as in ClipToRange
    const auto lo = double(int(within.begin[i])), hi = double(int(within.end[i]));
    begin[i] = int(Clamp(s.box_first[i], lo, hi));
    end[i] = int(Clamp(s.box_last[i] + 1, lo, hi));
    empty = empty || end[i] <= begin[i];
  }
  const auto ny = uint32_t(end[1] - begin[1]);
  if (writes) {
    shared.span_class = s.span_class;
    shared.base = s.base;
    shared.triangle = t;
    for (int i = 0; i < 3; ++i) {
      shared.begin[i] = begin[i];
      shared.end[i] = end[i];
      shared.cell[i] = int(Clamp(s.base[i], -0x1p30, 0x1p30));
    }
    shared.ny = ny;
    shared.one_over_ny = 1.0f / float(ny);
  }
  return empty ? 0 : uint64_t(ny) * uint64_t(end[2] - begin[2]);
}

// Sets up triangle t from its corners. Returns the number of its rows within `within`.
__device__ inline uint64_t SetUpShared(const Vec3d (&corners)[3], Coverage coverage, const VoxelRange& within,
                                       uint32_t t, SharedSetup& shared) {
  SetupInPlace s{shared.narrow, shared.wide, SpanClass::kRun, {}, {}, {}};
  SetUpTriangle(corners[0], corners[1], corners[2], coverage, s);
  return FinishShared(s, within, t, true, shared);
}
__device__ inline uint64_t SetUpShared(const Vec3d* positions, const uint32_t* triangles, Coverage coverage,
                                       const VoxelRange& within, uint32_t t, SharedSetup& shared) {
  const Corners c = LoadCorners(triangles, t);
  const Vec3d corners[3] = {positions[c.v[0]], positions[c.v[1]], positions[c.v[2]]};
  return SetUpShared(corners, coverage, within, t, shared);
}
// The same by kBoundsParts adjacent lanes of a block; the first lane's index is a multiple of kBoundsParts. Returns the
// number to each of them.
__device__ inline uint64_t SetUpSharedInParts(const Vec3d (&corners)[3], Coverage coverage, const VoxelRange& within,
                                              uint32_t t, SharedSetup& shared) {
  const int part = int(threadIdx.x) % kBoundsParts;
  SetupInParts s{{shared.narrow, part, {}, {}}, {shared.wide, part, {}, {}}, SpanClass::kRun, {}, {}, {}};
  SetUpTriangle(corners[0], corners[1], corners[2], coverage, s);
  return FinishShared(s, within, t, part == 0, shared);
}

// A layer of a shared setup.
template <typename Real>
__device__ inline Layer<Real> SharedLayer(const SpanBounds<Real>& bounds, const SharedSetup& s, int z) {
  return ComputeLayer(bounds, Real(double(z) - s.base.z));
}
// The same for a narrow triangle, which is at most about 34 voxels long: 32 bits suffice.
__device__ inline Layer<float> SharedLayer(const SpanBounds<float>& bounds, const SharedSetup& s, int z) {
  return ComputeLayer(bounds, float(z - s.cell[2]));
}

// A row of a layer with non-empty intervals, within the setup's box. False if the triangle does not touch it.
template <typename Real>
__device__ inline bool RowOfLayer(const SpanBounds<Real>& bounds, const Layer<Real>& layer, const SharedSetup& s, int y,
                                  int& x_begin, int& x_end) {
  const Real local = Real(double(y) - s.base.y);
  if (local < layer.y.first || local > layer.y.last) return false;
  const Interval<Real> row = ComputeRow(bounds, layer, local);
  if (row.empty()) return false;
  const double lo = double(s.begin[0]), hi = double(s.end[0]);
  x_begin = int(Clamp(s.base.x + double(row.first), lo, hi));
  x_end = int(Clamp((s.base.x + double(row.last)) + 1, lo, hi));
  return x_begin < x_end;
}

__device__ inline bool RowOfLayer(const SpanBounds<float>& bounds, const Layer<float>& layer, const SharedSetup& s,
                                  int y, int& x_begin, int& x_end) {
  const auto local = float(y - s.cell[1]);
  if (local < layer.y.first || local > layer.y.last) return false;
  const Interval<float> row = ComputeRow(bounds, layer, local);
  if (row.empty()) return false;
  x_begin = max(s.begin[0], s.cell[0] + int(row.first));
  x_end = min(s.end[0], s.cell[0] + int(row.last) + 1);
  return x_begin < x_end;
}

template <typename Real>
__device__ inline bool SharedRowOf(const SpanBounds<Real>& bounds, const SharedSetup& s, int y, int z, int& x_begin,
                                   int& x_end) {
  const Layer<Real> layer = SharedLayer(bounds, s, z);
  return !layer.y.empty() && !layer.x.empty() && RowOfLayer(bounds, layer, s, y, x_begin, x_end);
}

// Row number `row` of a shared setup. False if the triangle does not touch it.
__device__ inline bool SharedRowSpan(const SharedSetup& s, uint32_t row, int& y, int& z, int& x_begin, int& x_end) {
  // row / ny by a multiplication with the reciprocal, which is off by at most one below 2^24; else by a division.
  uint32_t layer = row < (1u << 24) ? uint32_t(float(row) * s.one_over_ny) : row / s.ny;
  if (layer * s.ny > row) --layer;
  if (row - layer * s.ny >= s.ny) ++layer;
  y = s.begin[1] + int(row - layer * s.ny);
  z = s.begin[2] + int(layer);
  x_begin = s.begin[0];
  x_end = s.end[0];
  if (s.span_class == SpanClass::kRun) return true;
  return s.span_class == SpanClass::kNarrow ? SharedRowOf(s.narrow, s, y, z, x_begin, x_end)
                                            : SharedRowOf(s.wide, s, y, z, x_begin, x_end);
}

// First kernel: one thread per triangle, by its box.
template <typename Op, typename Args = WalkArgs>
__global__ void __launch_bounds__(kRunThreads) WalkRuns(const __grid_constant__ Args args, Op op) {
  __shared__ unsigned long long room[3][kRunThreads / 32 + 1];
  const uint64_t t = uint64_t(blockIdx.x) * kRunThreads + threadIdx.x;
  enum { kNone, kRun, kLeast, kSmall, kRest } what = kNone;
  Box32 range;
  if (t < args.triangle_count) {
    const CodedBox box = LoadBox(args.codes, LoadCorners(args.triangles, t));
    if (box.far) {
      what = kRest;
    } else if (Clip(box, SlabBox(GridOf(args, uint32_t(t))), range)) {
      const int rows = range.rows();
      const Coverage coverage = CoverageOf(args, uint32_t(t));
      if (IsRun(box, coverage) && rows <= kRowsOfRun) {
        what = kRun;
      } else if (rows > kRowsOfThread || coverage == Coverage::kCenter) {
        what = kRest;
      } else {
        what = range.end[1] - range.begin[1] <= 2 && range.end[2] - range.begin[2] <= 2 ? kLeast : kSmall;
      }
    }
  }
  // Barriers come before the rows, whose atomics are slow. One atomic per block and queue, all at once.
  const unsigned lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  const unsigned waiting[3] = {__ballot_sync(~0u, what == kRest), __ballot_sync(~0u, what == kLeast),
                               __ballot_sync(~0u, what == kSmall)};
  if (lane < 3) room[lane][warp] = unsigned(__popc(waiting[lane == 0 ? 0 : lane == 1 ? 1 : 2]));
  __syncthreads();
  if (threadIdx.x < 3) {
    const int queue = threadIdx.x == 0 ? 0 : int(threadIdx.x) + 1;
    unsigned long long sum = 0;
    for (int w = 0; w < kRunThreads / 32; ++w) {
      const unsigned long long here = room[threadIdx.x][w];
      room[threadIdx.x][w] = sum;
      sum += here;
    }
    room[threadIdx.x][kRunThreads / 32] =
        sum == 0 ? 0 : atomicAdd(reinterpret_cast<unsigned long long*>(args.queued + queue), sum);
  }
  __syncthreads();
  if (what >= kLeast) {
    const int q = what == kRest ? 0 : what == kLeast ? 1 : 2;
    const unsigned before = q == 0 ? waiting[0] : q == 1 ? waiting[1] : waiting[2];
    const uint64_t at = room[q][kRunThreads / 32] + room[q][warp] + unsigned(__popc(before & ((1u << lane) - 1)));
    if (q == 0) args.rest_queue[at] = uint32_t(t);
    if (q == 1) args.small_queue[at] = uint32_t(t);
    if (q == 2) args.small_queue[args.triangle_count - 1 - at] = uint32_t(t);
  }
  if (t < args.triangle_count) {
    op.Begin(uint32_t(t));
    if (what == kRun) {
      for (int z = range.begin[2]; z < range.end[2]; ++z) {
        for (int y = range.begin[1]; y < range.end[1]; ++y) op.Row(y, z, range.begin[0], range.end[0]);
      }
    }
    op.End(uint32_t(t));
  }
  __syncwarp();
  op.Finish();
}

// Second kernel: one thread per small triangle. Triangles that are not narrow are appended to the rest queue.
template <typename Op, typename Args = WalkArgs>
__global__ void __launch_bounds__(kSmallThreads, 6) WalkSmall(const __grid_constant__ Args args, Op op) {
  // Rounded up: no warp processes both kinds.
  const uint64_t least = (args.queued[2] + 31) / 32 * 32, other = args.queued[3];
  const uint64_t threads = uint64_t(gridDim.x) * kSmallThreads;
  for (uint64_t i = uint64_t(blockIdx.x) * kSmallThreads + threadIdx.x; i < least + other; i += threads) {
    if (i >= args.queued[2] && i < least) continue;
    const uint32_t t = args.small_queue[i < least ? i : args.triangle_count - 1 - (i - least)];
    const Corners corners = LoadCorners(args.triangles, t);
    const CodedBox box = LoadBox(args.codes, corners);
    Box32 range;
    if (!Clip(box, SlabBox(GridOf(args, t)), range)) continue;
    SpanBounds<float> bounds;
    if (!SetUpNarrow(args.positions, CoverageOf(args, t), corners, box, bounds)) {
      if (!op.repeats()) {
        args.rest_queue[atomicAdd(reinterpret_cast<unsigned long long*>(args.queued), 1ull)] = t;
      }
      continue;
    }
    op.Begin(t);
    WalkNarrow(bounds, box.base, range, [&](int y, int z, int x_begin, int x_end) { op.Row(y, z, x_begin, x_end); });
    op.End(t);
  }
  __syncwarp();
  op.Finish();
}

// Third kernel: half of a warp's lanes set up one triangle each, then the warp shares the rows of each. The largest are
// deferred to WalkLarge.
template <typename Op, typename Args = WalkArgs>
__global__ void __launch_bounds__(kRestThreads, 6) WalkRest(const __grid_constant__ Args args, Op op) {
  extern __shared__ double setups[];
  const int lane = int(threadIdx.x % 32), warp_of_block = int(threadIdx.x / 32);
  auto* const shared = reinterpret_cast<SharedSetup*>(setups) + warp_of_block * kSetupsOfWarp;
  const uint64_t count = args.queued[0];
  const uint64_t warps = uint64_t(gridDim.x) * (kRestThreads / 32);
  // Few triangles are spread over all warps; many are processed in groups.
  const uint64_t each = min(uint64_t{kSetupsOfWarp}, (count + warps - 1) / warps);
  const uint64_t warp = uint64_t(blockIdx.x) * (kRestThreads / 32) + uint64_t(warp_of_block);
  for (uint64_t begin = warp * each; begin < count; begin += warps * each) {
    uint64_t rows = 0;
    if (uint64_t(lane) < each && begin + uint64_t(lane) < count) {
      const uint32_t t = args.rest_queue[begin + uint64_t(lane)];
      rows = SetUpShared(args.positions, args.triangles, CoverageOf(args, t), GridOf(args, t).SlabRange(), t,
                         shared[lane]);
      if (rows > kRowsOfWarp) {
        if (!op.repeats()) {
          args.large_queue[atomicAdd(reinterpret_cast<unsigned long long*>(args.queued + 1), 1ull)] = t;
        }
        rows = 0;
      }
    }
    __syncwarp();
    for (int i = 0; i < int(each); ++i) {
      const uint32_t rows_here = __shfl_sync(~0u, uint32_t(rows), i);
      const SharedSetup& s = shared[i];
      for (uint32_t row = uint32_t(lane); row < rows_here; row += 32) {
        int y, z, x_begin, x_end;
        if (SharedRowSpan(s, row, y, z, x_begin, x_end)) op.SharedRow(s.triangle, y, z, x_begin, x_end);
      }
    }
    __syncwarp();
  }
  op.Finish();
}

// Fourth kernel: the largest triangles one after the other, each by all threads.
template <typename Op, typename Args = WalkArgs>
__global__ void __launch_bounds__(kRestThreads, 6) WalkLarge(const __grid_constant__ Args args, Op op) {
  extern __shared__ double setups[];
  __shared__ uint64_t rows_of[kSetupsOfBlock];
  auto* const shared = reinterpret_cast<SharedSetup*>(setups);
  const uint64_t count = args.queued[1];
  const uint64_t threads = uint64_t(gridDim.x) * kRestThreads, me = uint64_t(blockIdx.x) * kRestThreads + threadIdx.x;
  for (uint64_t begin = 0; begin < count; begin += kSetupsOfBlock) {
    const int here = int(min(count - begin, uint64_t{kSetupsOfBlock}));
    if (int(threadIdx.x) < here) {
      const uint32_t t = args.large_queue[begin + threadIdx.x];
      rows_of[threadIdx.x] = SetUpShared(args.positions, args.triangles, CoverageOf(args, t),
                                         GridOf(args, t).SlabRange(), t, shared[threadIdx.x]);
    }
    __syncthreads();
    for (int i = 0; i < here; ++i) {
      for (uint64_t row = me; row < rows_of[i]; row += threads) {
        int y, z, x_begin, x_end;
        if (SharedRowSpan(shared[i], uint32_t(row), y, z, x_begin, x_end)) {
          op.SharedRow(shared[i].triangle, y, z, x_begin, x_end);
        }
      }
    }
    __syncthreads();
  }
  op.Finish();
}

}  // namespace voxelpipe::cuda
