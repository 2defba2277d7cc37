// Occupancy bits of one grid, second step: triangles that are large, or for which the filter of small_triangles.cuh is
// uncertain, by exact setups in higher precision.
//
//   WalkLayers  lanes of a warp set up one triangle each, then the warp shares the layers of all
//   WalkLarge   the largest triangles: warps share their layers, lanes the rows of a layer
// No host-only includes.
#pragma once

#include "cuda/traversal/shared_setup.cuh"

namespace voxelpipe::cuda {

inline constexpr int kLayerLanes = 4;    // lanes per layer in WalkLayers: rows of a layer are close in memory
inline constexpr int kLargeSetups = 32;  // per block

// Sets the bits of rows offset, offset + step, ... of a layer.
template <typename Real>
__device__ inline void WalkLayer(const BitArgs& args, const SpanBounds<Real>& bounds, const SharedSetup& s, int z,
                                 int offset, int step) {
  const Layer<Real> layer = ComputeLayer(bounds, Real(double(z) - s.base.z));
  if (layer.y.empty() || layer.x.empty()) return;
  const double y_lo = double(s.begin[1]), y_hi = double(s.end[1]), x_lo = double(s.begin[0]), x_hi = double(s.end[0]);
  const int y_end = int(Clamp((s.base.y + double(layer.y.last)) + 1, y_lo, y_hi));
  for (int y = int(Clamp(s.base.y + double(layer.y.first), y_lo, y_hi)) + offset; y < y_end; y += step) {
    const Interval<Real> row = ComputeRow(bounds, layer, Real(double(y) - s.base.y));
    if (row.empty()) continue;
    const int x_begin = int(Clamp(s.base.x + double(row.first), x_lo, x_hi));
    const int x_end = int(Clamp((s.base.x + double(row.last)) + 1, x_lo, x_hi));
    if (x_begin < x_end) SetRow(args, y, z, x_begin, x_end);
  }
}
// The same for a narrow triangle, which is at most about 34 voxels long: 32 bits suffice.
__device__ inline void WalkLayer(const BitArgs& args, const SpanBounds<float>& bounds, const SharedSetup& s, int z,
                                 int offset, int step) {
  const Layer<float> layer = ComputeLayer(bounds, float(z - s.cell[2]));
  if (layer.y.empty() || layer.x.empty()) return;
  const int y_end = min(s.end[1], s.cell[1] + int(layer.y.last) + 1);
  for (int y = max(s.begin[1], s.cell[1] + int(layer.y.first)) + offset; y < y_end; y += step) {
    const Interval<float> row = ComputeRow(bounds, layer, float(y - s.cell[1]));
    if (row.empty()) continue;
    const int x_begin = max(s.begin[0], s.cell[0] + int(row.first)),
              x_end = min(s.end[0], s.cell[0] + int(row.last) + 1);
    if (x_begin < x_end) SetRow(args, y, z, x_begin, x_end);
  }
}
__device__ __noinline__ inline void WalkLayer(const BitArgs& args, const SharedSetup& s, int z, int offset, int step) {
  if (s.span_class == SpanClass::kNarrow) return WalkLayer(args, s.narrow, s, z, offset, step);
  if (s.span_class == SpanClass::kWide) return WalkLayer(args, s.wide, s, z, offset, step);
  for (int y = s.begin[1] + offset; y < s.end[1]; y += step) SetRow(args, y, z, s.begin[0], s.end[0]);
}

// Rasterizes all layers of a warp's triangles. `layers`: number of layers of the lane's triangle.
template <int kSetups>
__device__ inline void WalkSetUp(const BitArgs& args, const SharedSetup* shared, uint32_t layers) {
  const int lane = int(threadIdx.x % 32);
  uint32_t total;
  const uint32_t before = WarpExclusiveSum(layers, total);
  __syncwarp();
  for (uint32_t first = 0; first < total; first += 32 / kLayerLanes) {
    const uint32_t item = first + uint32_t(lane / kLayerLanes);
    const int i = LaneOfItem<kSetups>(before, item);
    const uint32_t begins = __shfl_sync(~0u, before, i);
    if (item < total) {
      WalkLayer(args, shared[i], shared[i].begin[2] + int(item - begins), lane % kLayerLanes, kLayerLanes);
    }
  }
  __syncwarp();
}

// Processes the layer queue of `count` triangles, by warp `warp` of `warps`, with shared memory for kSetups.
template <int kSetups>
__device__ inline void WalkLayers(const BitArgs& args, uint64_t count, uint64_t warp, uint64_t warps,
                                  SharedSetup* shared) {
  // Few triangles are spread over all warps; many are processed in groups.
  const uint64_t each = min(uint64_t{kSetups}, (count + warps - 1) / warps);
  for (uint64_t begin = warp * each; begin < count; begin += warps * each) {
    const uint32_t* const queue = args.layer_queue + begin;
    const uint64_t rows = SetUpRowsOfWarp(
        args, uint32_t(min(each, count - begin)), [&](uint32_t i) { return __ldcg(queue + i); }, shared);
    WalkSetUp<kSetups>(args, shared, rows == 0 ? 0 : LayersOf(shared[threadIdx.x % 32]));
  }
}

struct LargeRoom {
  SharedSetup setups[kLargeSetups];
  uint32_t before[kLargeSetups + 1];
};

inline constexpr int kLargeThreads = kLargeSetups * kBoundsParts;  // block size of kernels that call WalkLarge

// Processes the large queue of `queued` triangles, by block `block` of `blocks`. Batches of triangles are dealt to
// blocks; if there are more blocks than batches, several blocks share one.
__device__ inline void WalkLarge(const BitArgs& args, uint64_t queued, uint32_t block, uint32_t blocks,
                                 LargeRoom& room) {
  if (queued == 0) return;
  const uint32_t* const queue = args.large_queue;
  const uint64_t count = queued;
  const uint64_t batches = (count + kLargeSetups - 1) / kLargeSetups, each = (count + batches - 1) / batches;
  const auto warps = uint32_t(blockDim.x / 32), warp = uint32_t(threadIdx.x / 32), lane = uint32_t(threadIdx.x % 32);
  for (uint64_t batch = block % batches; batch < batches; batch += blocks) {
    const auto sharing = batches >= blocks ? 1 : uint32_t((blocks - 1 - batch) / batches + 1);
    const auto part = batches >= blocks ? 0 : uint32_t(block / batches);
    const int here = int(min(count - batch * each, each));
    const uint32_t place = threadIdx.x / kBoundsParts;
    const uint32_t t = place < uint32_t(here) ? __ldcg(queue + batch * each + place) : kNoTriangle;
    const uint64_t rows = SetUpRowsInParts(args, t, room.setups[place]);
    if (threadIdx.x % kBoundsParts == 0) room.before[place] = rows == 0 ? 0 : LayersOf(room.setups[place]);
    __syncthreads();
    if (warp == 0) {
      uint32_t total;
      const uint32_t before = WarpExclusiveSum(room.before[lane], total);
      room.before[lane] = before;
      if (lane == 0) room.before[kLargeSetups] = total;
    }
    __syncthreads();
    const uint32_t total = room.before[kLargeSetups];
    for (uint32_t item = part * warps + warp; item < total; item += sharing * warps) {
      int i = 0;
      while (i + 1 < here && room.before[i + 1] <= item) ++i;
      WalkLayer(args, room.setups[i], room.setups[i].begin[2] + int(item - room.before[i]), int(lane), 32);
    }
    __syncthreads();
  }
}

}  // namespace voxelpipe::cuda
