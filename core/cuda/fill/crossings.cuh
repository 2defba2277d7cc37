// Crossings of triangles with the lines along x through the centres of rows, for the parity fill, the nonzero fill and
// batches. Included by .cu files only.
//
// Source: the fill of M. Schwarz and H.-P. Seidel, "Fast Parallel Surface and Solid Voxelization on GPUs", 2010,
// section 5. Differences: crossings are counted per edge (raster/crossing.h), so closed meshes leave no streaks; a
// single bit is toggled per crossing and spread at the end.
#pragma once

#include "absl/status/status.h"
#include "cuda/device/check.h"
#include "cuda/device/device.h"
#include "cuda/device/launch.cuh"
#include "cuda/primitives/views.h"
#include "cuda/traversal/row_traversal.cuh"
#include "raster/crossing.h"
#include "shaders/fill_value.h"

namespace voxelpipe::cuda {

inline constexpr int kFillThreads = 256;
inline constexpr uint32_t kLinesOfThread = 32;
inline constexpr uint64_t kLinesOfWarp = 1024;

// Output of the parity fill.
struct ToggleView {
  GridView grid;
  uint32_t* inside = nullptr;  // bit grid of the slab
  // One bit per column (j, k) of the slab: the parity of all its crossings; rows of column_words words.
  uint32_t* columns = nullptr;
  int64_t column_words = 0;
};

// Output of the nonzero fill: signs of crossings in a range of the slab's rows, numbered as in bit grids.
struct SumView {
  GridView grid;
  uint64_t first_row = 0, end_row = 0;
  uint32_t* inside = nullptr;  // bit grid of the slab: the last voxel before each crossing, if any
  // Sums for these rows modulo 2^32, +1 for a rising and -1 for a falling crossing: `sums` by the bit of that voxel,
  // `outside` by row, for crossings before all voxels.
  uint32_t *sums = nullptr, *outside = nullptr;
};

// The triangles of a run, and their common output.
template <typename ViewType>
struct CrossingArgs {
  using View = ViewType;
  View view;
  const uint32_t* triangles;
  const Vec3d* positions;  // index space
  uint64_t triangle_count;
  // Triangles with more than kLinesOfThread lines from the front on, those with more than kLinesOfWarp from the end on;
  // how many of the one and of the other.
  uint32_t* queue;
  uint64_t* queued;
};
using ToggleArgs = CrossingArgs<ToggleView>;
using SumArgs = CrossingArgs<SumView>;
// The output of a triangle; false if its mesh is not filled.
template <typename View>
__device__ inline bool ViewOf(const CrossingArgs<View>& args, uint64_t, View& view) {
  view = args.view;
  return true;
}
// The range of lines along x, through the centres of (y, z), that may cross the triangle.
struct Lines {
  int64_t y_begin, y_end, z_begin, z_end;
  __device__ uint64_t count() const {
    return y_begin < y_end && z_begin < z_end ? uint64_t(y_end - y_begin) * uint64_t(z_end - z_begin) : 0;
  }
};

struct Corners {
  Vec3d a, b, c;
};

template <typename Args>
__device__ inline Corners Load(const Args& args, uint64_t t) {
  const uint32_t* v = args.triangles + 3 * t;
  return {args.positions[v[0]], args.positions[v[1]], args.positions[v[2]]};
}

__device__ inline void CentreRange(double lo, double hi, int64_t first, int64_t last, int64_t& begin, int64_t& end) {
  begin = int64_t(Clamp(floor(lo - 0.5), double(first), double(last)));
  end = int64_t(Clamp(ceil(hi - 0.5) + 1, double(first), double(last)));
}

__device__ inline Lines LinesOf(const ToggleView& args, const Corners& t) {
  Lines lines;
  CentreRange(Min(t.a.y, Min(t.b.y, t.c.y)), Max(t.a.y, Max(t.b.y, t.c.y)), 0, args.grid.dims[1], lines.y_begin,
              lines.y_end);
  CentreRange(Min(t.a.z, Min(t.b.z, t.c.z)), Max(t.a.z, Max(t.b.z, t.c.z)), args.grid.slab_begin, args.grid.slab_end,
              lines.z_begin, lines.z_end);
  return lines;
}

// Of the layers that rows [first_row, end_row) of the slab lie in.
__device__ inline Lines LinesOfRows(const GridView& grid, uint64_t first_row, uint64_t end_row, const Corners& t) {
  const auto ny = uint64_t(grid.dims[1]);
  const int64_t first = grid.slab_begin + int64_t(first_row / ny);
  const int64_t last = grid.slab_begin + int64_t((end_row - 1) / ny);
  Lines lines;
  CentreRange(Min(t.a.y, Min(t.b.y, t.c.y)), Max(t.a.y, Max(t.b.y, t.c.y)), 0, grid.dims[1], lines.y_begin,
              lines.y_end);
  CentreRange(Min(t.a.z, Min(t.b.z, t.c.z)), Max(t.a.z, Max(t.b.z, t.c.z)), first, last + 1, lines.z_begin,
              lines.z_end);
  return lines;
}

__device__ inline Lines LinesOf(const SumView& args, const Corners& t) {
  return LinesOfRows(args.grid, args.first_row, args.end_row, t);
}

__device__ inline void ToggleLine(const SumView& args, const Corners& t, int64_t y, int64_t z) {
  const uint64_t row = uint64_t(y + args.grid.dims[1] * (z - args.grid.slab_begin));
  if (row < args.first_row || row >= args.end_row) return;
  const double py = double(y) + 0.5, pz = double(z) + 0.5;
  if (!LineCrosses(t.a, t.b, t.c, py, pz)) return;
  const uint32_t sign = CrossingFalls(t.a, t.b, t.c, py, pz) ? ~0u : 1u;
  const TrianglePlane plane = SetUpPlane(t.a, t.b, t.c);
  const int64_t before = CentresBefore(CrossingX(plane, t.a, t.b, t.c, py, pz), args.grid.dims[0]);
  const uint64_t here = row - args.first_row;
  if (before == 0) {
    atomicAdd(args.outside + here, sign);
    return;
  }
  atomicOr(args.inside + args.grid.Word(before - 1, y, z), 1u << ((before - 1) % 32));
  atomicAdd(args.sums + here * uint64_t(args.grid.words_per_row) * 32 + uint64_t(before - 1), sign);
}

__device__ inline void ToggleLine(const ToggleView& args, const Corners& t, int64_t y, int64_t z) {
  const double py = double(y) + 0.5, pz = double(z) + 0.5;
  if (!LineCrosses(t.a, t.b, t.c, py, pz)) return;
  atomicXor(args.columns + (z - args.grid.slab_begin) * args.column_words + y / 32, 1u << (y % 32));
  const TrianglePlane plane = SetUpPlane(t.a, t.b, t.c);
  const int64_t before = CentresBefore(CrossingX(plane, t.a, t.b, t.c, py, pz), args.grid.dims[0]);
  if (before > 0) atomicXor(args.inside + args.grid.Word(before - 1, y, z), 1u << ((before - 1) % 32));
}

// One thread per triangle; triangles with more lines are queued.
template <typename Args>
__global__ void __launch_bounds__(kFillThreads) ToggleSmall(const __grid_constant__ Args args) {
  __shared__ unsigned long long room[2][kFillThreads / 32 + 1];
  const uint64_t t = uint64_t(blockIdx.x) * kFillThreads + threadIdx.x;
  bool some = false, many = false;
  typename Args::View view;
  if (t < args.triangle_count && ViewOf(args, t, view)) {
    const Corners corners = Load(args, t);
    const Lines lines = LinesOf(view, corners);
    const uint64_t count = lines.count();
    many = count > kLinesOfWarp;
    some = count > kLinesOfThread && !many;
    if (count > 0 && count <= kLinesOfThread) {
      for (int64_t z = lines.z_begin; z < lines.z_end; ++z) {
        for (int64_t y = lines.y_begin; y < lines.y_end; ++y) ToggleLine(view, corners, y, z);
      }
    }
  }
  if (__syncthreads_or(some || many) == 0) return;
  const uint64_t at_some = BlockAllocate<kFillThreads>(args.queued, some, room[0]);
  if (some) args.queue[at_some] = uint32_t(t);
  const uint64_t at_many = BlockAllocate<kFillThreads>(args.queued + 1, many, room[1]);
  if (many) args.queue[args.triangle_count - 1 - at_many] = uint32_t(t);
}

// Lines begin, begin + step, ... of a triangle.
template <typename Args>
__device__ inline void ToggleLines(const Args& args, uint64_t t, uint64_t begin, uint64_t step) {
  typename Args::View view;
  ViewOf(args, t, view);
  const Corners corners = Load(args, t);
  const Lines lines = LinesOf(view, corners);
  const uint64_t count = lines.count(), ny = uint64_t(lines.y_end - lines.y_begin);
  for (uint64_t line = begin; line < count; line += step) {
    ToggleLine(view, corners, lines.y_begin + int64_t(line % ny), lines.z_begin + int64_t(line / ny));
  }
}

// A warp takes a triangle with some lines; gridDim.x blocks share one with many, gridDim.y divides these.
template <typename Args>
__global__ void __launch_bounds__(kFillThreads) ToggleLarge(const __grid_constant__ Args args) {
  constexpr uint64_t kWarps = kFillThreads / 32;
  const uint64_t some = args.queued[0], many = args.queued[1];
  const uint64_t block = uint64_t(blockIdx.y) * gridDim.x + blockIdx.x,
                 warps = uint64_t(gridDim.x) * gridDim.y * kWarps;
  for (uint64_t i = block * kWarps + threadIdx.x / 32; i < some; i += warps) {
    ToggleLines(args, args.queue[i], threadIdx.x % 32, 32);
  }
  for (uint64_t i = blockIdx.y; i < many; i += gridDim.y) {
    ToggleLines(args, args.queue[args.triangle_count - 1 - i], uint64_t(blockIdx.x) * kFillThreads + threadIdx.x,
                uint64_t(gridDim.x) * kFillThreads);
  }
}

// Suffix parity: bit i of a row becomes the parity of the toggles at i and beyond. A warp processes a row from its end.
__device__ inline void SuffixXorRow(uint32_t* at, int64_t words) {
  const int lane = int(threadIdx.x % 32);
  uint32_t carry = 0;  // all bits set if an odd number of toggles lies beyond
  for (int64_t end = words; end > 0; end -= 32) {
    const int64_t w = end - 32 + lane;
    uint32_t word = w >= 0 ? at[w] : 0;
    const uint32_t odd = __ballot_sync(~0u, __popc(word) & 1);
    if (odd == 0 && carry == 0 && __ballot_sync(~0u, word != 0) == 0) continue;
    for (int shift = 1; shift < 32; shift *= 2) word ^= word >> shift;
    const uint32_t beyond = lane == 31 ? 0 : odd >> (lane + 1);
    if ((__popc(beyond) & 1) != 0) word = ~word;
    if (w >= 0) at[w] = word ^ carry;
    if ((__popc(odd) & 1) != 0) carry = ~carry;
  }
}

struct FillArgs {
  uint8_t* dense;
  int components;
  FillValue fill;
  const uint32_t *inside, *present;  // bit grids of the slab
  // If the value differs from part to part: by rank, and of each voxel the rank of the part around it plus 1.
  const FillValue* of_parts = nullptr;
  const uint16_t* ranks = nullptr;
  uint64_t words, voxels;
  int64_t nx, ny, first_layer, words_per_row;
  bool planar;
};

// Stores the fill value in the filled voxels of words begin, begin + step, ... that have no fragment of the target: one
// warp per word, one lane per voxel.
template <typename Element>
__device__ inline void FillWords(const FillArgs& args, uint64_t begin, uint64_t step) {
  auto* const out = reinterpret_cast<Element*>(args.dense);
  const auto components = uint64_t(args.components);
  const unsigned lane = threadIdx.x % 32;
  for (uint64_t word = begin; word < args.words; word += step) {
    if (((args.inside[word] & ~args.present[word]) >> lane & 1) == 0) continue;
    const uint64_t row = word / uint64_t(args.words_per_row), w = word % uint64_t(args.words_per_row);
    const uint64_t n = row * uint64_t(args.nx) + w * 32 + lane;
    const FillValue& fill = args.of_parts == nullptr ? args.fill : args.of_parts[args.ranks[n] - 1];
    int64_t y = 0, z = 0;
    if (fill.kind != FillValue::Kind::kStored) {
      y = int64_t(row % uint64_t(args.ny));
      z = int64_t(row / uint64_t(args.ny)) + args.first_layer;
    }
    for (uint64_t c = 0; c < components; ++c) {
      const uint32_t stored = FillStored(fill, int64_t(w * 32 + lane), y, z, int(c));
      out[args.planar ? c * args.voxels + n : n * components + c] = Element(stored);
    }
  }
}

// `share`: blocks per triangle with many lines. The two counters of the queue are 0 before.
template <typename Args>
absl::Status Toggle(const Args& args, const DeviceInfo& device, unsigned share, cudaStream_t stream) {
  ToggleSmall<<<unsigned((args.triangle_count + kFillThreads - 1) / kFillThreads), kFillThreads, 0, stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ToggleSmall");
  ToggleLarge<<<dim3(share, unsigned(device.multiprocessors) * 8 / share), kFillThreads, 0, stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ToggleLarge");
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
