// Plain bits: rows of voxels set straight in the bit grid, without tiles.
//
// Each triangle's rows are words of at most 32 voxels that atomic ORs set; full words between them are stored. Triangles go by the number
// of their rows: few to one thread, more to a warp, the largest to all blocks together.
#include <cstdint>

#include "cuda/row_walk.cuh"
#include "cuda/run_state.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;
constexpr uint32_t kRowsOfThread = 32, kRowsOfWarp = 4096;

struct RowArgs {
  GridView grid;  // with the slab that `bits` is of
  Coverage coverage;
  const uint32_t* triangles;
  const Vec3d* positions;  // index space
  uint64_t triangle_count;
  uint32_t* bits;
  uint32_t* queue[2];
  uint64_t* counters;
  bool look_first;  // many triangles a voxel: most bits are set already, and reading is cheaper than an atomic
};

template <bool kLookFirst>
__device__ inline void Set(uint32_t* word, uint32_t mask) {
  if (kLookFirst && (__ldca(word) & mask) == mask) return;
  atomicOr(word, mask);
}

template <bool kLookFirst>
__device__ inline void SetRow(const RowArgs& args, int64_t y, int64_t z, int64_t x_begin, int64_t x_end) {
  uint32_t* const row = args.bits + args.grid.Word(0, y, z);
  const int64_t first = x_begin / 32, last = (x_end - 1) / 32;
  const uint32_t from = ~0u << (x_begin % 32), upto = ~0u >> (31 - (x_end - 1) % 32);
  if (first == last) return Set<kLookFirst>(row + first, from & upto);
  Set<kLookFirst>(row + first, from);
  for (int64_t w = first + 1; w < last; ++w) row[w] = ~0u;
  Set<kLookFirst>(row + last, upto);
}

__device__ inline TriangleSetup SetUp(const RowArgs& args, uint64_t t) {
  const uint32_t* v = args.triangles + 3 * t;
  return SetUpTriangle(args.positions[v[0]], args.positions[v[1]], args.positions[v[2]], args.coverage);
}

// One triangle a thread; what is too large goes to a queue.
template <bool kLookFirst>
__global__ void __launch_bounds__(kThreads) RasterSmall(const RowArgs args) {
  __shared__ unsigned long long room[2][kThreads / 32 + 1];
  const uint64_t t = uint64_t(blockIdx.x) * kThreads + threadIdx.x;
  int queue = -1;
  if (t < args.triangle_count) {
    const TriangleSetup s = SetUp(args, t);
    const VoxelRange range = ClipToRange(s, args.grid.SlabRange());
    if (!range.empty()) {
      if (IsForOneThread(s, range, kRowsOfThread)) {
        WalkRows(s, range,
                 [&](int y, int z, int x_begin, int x_end) { SetRow<kLookFirst>(args, y, z, x_begin, x_end); });
      } else {
        queue = RowCount(range) <= kRowsOfWarp ? 0 : 1;
      }
    }
  }
  if (__syncthreads_or(queue >= 0) == 0) return;
  for (int q = 0; q < 2; ++q) {
    const uint64_t at = BlockAllocate<kThreads>(args.counters + kQueued0 + q, queue == q, room[q]);
    if (queue == q) args.queue[q][at] = uint32_t(t);
  }
}

// A warp takes a triangle of queue 0 and deals its rows to its lanes.
__global__ void __launch_bounds__(kThreads) RasterMiddle(const RowArgs args) {
  const uint64_t count = args.counters[kQueued0];
  const uint64_t warps = uint64_t(gridDim.x) * (kThreads / 32);
  for (uint64_t i = uint64_t(blockIdx.x) * (kThreads / 32) + threadIdx.x / 32; i < count; i += warps) {
    const TriangleSetup s = SetUp(args, args.queue[0][i]);
    const VoxelRange range = ClipToRange(s, args.grid.SlabRange());
    const uint32_t rows = RowCount(range);
    for (uint32_t row = threadIdx.x % 32; row < rows; row += 32) {
      int64_t y, z, x_begin, x_end;
      if (RowSpan(s, range, row, y, z, x_begin, x_end)) SetRow<false>(args, y, z, x_begin, x_end);
    }
  }
}

// All threads of all blocks take their rows of each triangle of queue 1.
__global__ void __launch_bounds__(kThreads) RasterLarge(const RowArgs args) {
  const uint64_t count = args.counters[kQueued1];
  const uint64_t threads = uint64_t(gridDim.x) * kThreads, me = uint64_t(blockIdx.x) * kThreads + threadIdx.x;
  for (uint64_t i = 0; i < count; ++i) {
    const TriangleSetup s = SetUp(args, args.queue[1][i]);
    const VoxelRange range = ClipToRange(s, args.grid.SlabRange());
    const uint64_t rows = uint64_t(range.end[1] - range.begin[1]) * uint64_t(range.end[2] - range.begin[2]);
    for (uint64_t row = me; row < rows; row += threads) {
      int64_t y, z, x_begin, x_end;
      if (RowSpan(s, range, row, y, z, x_begin, x_end)) SetRow<false>(args, y, z, x_begin, x_end);
    }
  }
}

}  // namespace

absl::Status RasterRows(RunState& state, Coverage coverage, int64_t z_begin, int64_t z_end, uint32_t* bits) {
  const uint64_t triangles = state.mesh.host_view.triangle_count;
  if (triangles == 0) return absl::OkStatus();
  for (auto& queue : state.queue) VOXELPIPE_OK_OR_RETURN(queue.Resize(triangles, state.stream));
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kQueued0, kQueued1}));
  RowArgs args;
  args.grid = state.view;
  args.grid.slab_begin = z_begin;
  args.grid.slab_end = z_end;
  args.coverage = coverage;
  args.triangles = state.mesh.triangles.data();
  args.positions = state.mesh.index_positions.data();
  args.triangle_count = triangles;
  args.bits = bits;
  for (int q = 0; q < 2; ++q) args.queue[q] = state.queue[q].data();
  args.counters = state.counters.data();
  const int64_t* const d = state.view.dims;
  const double surface = double(d[0]) * double(d[1]) + double(d[1]) * double(d[2]) + double(d[2]) * double(d[0]);
  args.look_first = double(triangles) > 16 * surface;
  const auto blocks = unsigned((triangles + kThreads - 1) / kThreads);
  if (args.look_first) {
    RasterSmall<true><<<blocks, kThreads, 0, state.stream>>>(args);
  } else {
    RasterSmall<false><<<blocks, kThreads, 0, state.stream>>>(args);
  }
  VOXELPIPE_LAUNCHED_OR_RETURN("RasterSmall");
  const auto resident = unsigned(state.device.multiprocessors) * 4;
  RasterMiddle<<<unsigned(std::min<uint64_t>(resident, (triangles + 7) / 8)), kThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("RasterMiddle");
  RasterLarge<<<resident, kThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("RasterLarge");
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
