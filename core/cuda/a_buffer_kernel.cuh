// The emitting kernels of the A-buffer. No host-only includes: NVRTC compiles them too.
#pragma once

#include "cuda/row_walk.cuh"
#include "cuda/views.h"

namespace voxelpipe::cuda {

inline constexpr int kEmitThreads = 256;
inline constexpr uint32_t kEmitRowsOfThread = 32;

struct EmitArgs {
  GridView grid;
  Coverage coverage{};
  const uint32_t* triangles = nullptr;
  const Vec3d* positions = nullptr;  // index space
  uint64_t triangle_count = 0;
  uint32_t* counts = nullptr;       // per triangle: counted, then used to count again what was emitted
  const uint64_t* first = nullptr;  // per triangle: where its fragments go
  uint32_t* queue = nullptr;        // triangles that are too large for a thread
  uint64_t* queued = nullptr;
  void* keys = nullptr;        // voxel index within the slab
  uint32_t* values = nullptr;  // triangle
};

__device__ inline TriangleSetup SetUp(const EmitArgs& args, uint64_t t) {
  const uint32_t* v = args.triangles + 3 * t;
  return SetUpTriangle(args.positions[v[0]], args.positions[v[1]], args.positions[v[2]], args.coverage);
}

template <typename Key>
__device__ inline void EmitRow(const EmitArgs& args, uint64_t at, uint32_t triangle, int64_t y, int64_t z,
                               int64_t x_begin, int64_t x_end) {
  Key* const keys = static_cast<Key*>(args.keys);
  const auto row = uint64_t(args.grid.dims[0]) * uint64_t(y + args.grid.dims[1] * (z - args.grid.slab_begin));
  for (int64_t x = x_begin; x < x_end; ++x, ++at) {
    keys[at] = Key(row + uint64_t(x));
    args.values[at] = triangle;
  }
}

// Counts a thread's triangle, or queues it.
__global__ void __launch_bounds__(kEmitThreads) CountSmall(const __grid_constant__ EmitArgs args) {
  __shared__ unsigned long long room[kEmitThreads / 32 + 1];
  const uint64_t t = uint64_t(blockIdx.x) * kEmitThreads + threadIdx.x;
  bool queue = false;
  if (t < args.triangle_count) {
    const TriangleSetup s = SetUp(args, t);
    const VoxelRange range = ClipToRange(s, args.grid.SlabRange());
    uint32_t count = 0;
    if (!range.empty()) {
      if (IsForOneThread(s, range, kEmitRowsOfThread)) {
        WalkRows(s, range, [&](int, int, int x_begin, int x_end) { count += uint32_t(x_end - x_begin); });
      } else {
        queue = true;
      }
    }
    args.counts[t] = count;
  }
  if (__syncthreads_or(queue) == 0) return;
  const uint64_t at = BlockAllocate<kEmitThreads>(args.queued, queue, room);
  if (queue) args.queue[at] = uint32_t(t);
}

// Emits a thread's triangle; sets the counts of the queued to 0, which CountLarge's twin counts up again.
template <typename Key>
__global__ void __launch_bounds__(kEmitThreads) EmitSmall(const __grid_constant__ EmitArgs args) {
  const uint64_t t = uint64_t(blockIdx.x) * kEmitThreads + threadIdx.x;
  if (t >= args.triangle_count || args.counts[t] == 0) return;
  const TriangleSetup s = SetUp(args, t);
  const VoxelRange range = ClipToRange(s, args.grid.SlabRange());
  if (!IsForOneThread(s, range, kEmitRowsOfThread)) {
    args.counts[t] = 0;
    return;
  }
  uint64_t at = args.first[t];
  WalkRows(s, range, [&](int y, int z, int x_begin, int x_end) {
    EmitRow<Key>(args, at, uint32_t(t), y, z, x_begin, x_end);
    at += uint64_t(x_end - x_begin);
  });
}

// Calls visit(triangle, y, z, x_begin, x_end) for the rows of the queued triangles, dealt to all blocks: blocks in x share a triangle,
// blocks in y take different ones. All lanes of a warp call it together, with an empty span where they have none.
template <typename Visit>
__device__ inline void ForEachQueuedRow(const EmitArgs& args, const Visit& visit) {
  const uint64_t queued = *args.queued;
  for (uint64_t i = blockIdx.y; i < queued; i += gridDim.y) {
    const uint32_t t = args.queue[i];
    const TriangleSetup s = SetUp(args, t);
    const VoxelRange range = ClipToRange(s, args.grid.SlabRange());
    const uint64_t rows = uint64_t(range.end[1] - range.begin[1]) * uint64_t(range.end[2] - range.begin[2]);
    for (uint64_t first = uint64_t(blockIdx.x) * kEmitThreads; first < rows;
         first += uint64_t(gridDim.x) * kEmitThreads) {
      const uint64_t row = first + threadIdx.x;
      int64_t y = 0, z = 0, x_begin = 0, x_end = 0;
      if (row >= rows || !RowSpan(s, range, row, y, z, x_begin, x_end)) x_begin = x_end = 0;
      visit(t, y, z, x_begin, x_end);
    }
  }
}

__global__ void __launch_bounds__(kEmitThreads) CountLarge(const __grid_constant__ EmitArgs args) {
  ForEachQueuedRow(args, [&](uint32_t t, int64_t, int64_t, int64_t x_begin, int64_t x_end) {
    uint32_t sum = uint32_t(x_end - x_begin);
    for (int step = 16; step > 0; step /= 2) sum += __shfl_down_sync(~0u, sum, step);
    if (threadIdx.x % 32 == 0 && sum > 0) atomicAdd(args.counts + t, sum);
  });
}

template <typename Key>
__global__ void __launch_bounds__(kEmitThreads) EmitLarge(const __grid_constant__ EmitArgs args) {
  ForEachQueuedRow(args, [&](uint32_t t, int64_t y, int64_t z, int64_t x_begin, int64_t x_end) {
    uint32_t total;
    const uint32_t before = WarpExclusiveSum(uint32_t(x_end - x_begin), total);
    uint32_t taken = 0;
    if (threadIdx.x % 32 == 0 && total > 0) taken = atomicAdd(args.counts + t, total);
    taken = __shfl_sync(~0u, taken, 0);
    EmitRow<Key>(args, args.first[t] + taken + before, t, y, z, x_begin, x_end);
  });
}

}  // namespace voxelpipe::cuda
