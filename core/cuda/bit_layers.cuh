// Plain bits of one grid: triangles that bit_walk.cuh is not certain of, and those that are larger, by set-ups in higher precision.
//
//   WalkLayers  lanes of a warp set up a triangle each, exactly, then all share their layers
//   WalkLarge   the largest: warps share their layers, lanes the rows of one
// No host-only includes.
#pragma once

#include "cuda/bit_grid.cuh"

namespace voxelpipe::cuda {

inline constexpr int kLayerLanes = 4;    // share a layer in WalkLayers: rows of one lie near each other in memory
inline constexpr int kLargeSetups = 32;  // of a block

// Sets up triangle t in shared memory; the number of its layers.
__device__ __noinline__ inline uint32_t SetUpLayers(const BitArgs& args, uint32_t t, SharedSetup& shared) {
  const PlacedCorners p = PlaceCorners(args, t);
  constexpr uint32_t kOrder[3] = {0, 1, 2};
  const uint64_t rows = SetUpShared(p.at, kOrder, args.coverage, args.grid.SlabRange(), 0, shared);
  return rows == 0 ? 0 : uint32_t(shared.end[2] - shared.begin[2]);
}

// Rows offset, offset + step, ... of a layer of a set-up triangle.
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
// The same of a narrow triangle, which is at most some 34 voxels long: its box tells that 32 bits do.
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

// All layers of a warp's set-up triangles, each of whose lanes brings how many its own has.
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

// The layer queue, which has `count` triangles, by warp `warp` of `warps`, which has room for kSetups.
template <int kSetups>
__device__ inline void WalkLayers(const BitArgs& args, uint64_t count, uint64_t warp, uint64_t warps,
                                  SharedSetup* shared) {
  const int lane = int(threadIdx.x % 32);
  // Few triangles are spread over all warps, many are taken together.
  const uint64_t each = min(uint64_t{kSetups}, (count + warps - 1) / warps);
  for (uint64_t begin = warp * each; begin < count; begin += warps * each) {
    uint32_t layers = 0;
    if (uint64_t(lane) < each && begin + uint64_t(lane) < count) {
      layers = SetUpLayers(args, __ldcg(args.layer_queue + begin + uint64_t(lane)), shared[lane]);
    }
    WalkSetUp<kSetups>(args, shared, layers);
  }
}

struct LargeRoom {
  SharedSetup setups[kLargeSetups];
  uint32_t before[kLargeSetups + 1];
};

// The large queue, which has `queued` triangles, by block `block` of `blocks`. Batches of triangles are dealt to the blocks; where those are
// more, several share one.
__device__ inline void WalkLarge(const BitArgs& args, uint64_t queued, uint32_t block, uint32_t blocks,
                                 LargeRoom& room) {
  if (queued <= args.drawn_large) return;
  const uint32_t* const queue = args.large_queue + args.drawn_large;
  const uint64_t count = queued - args.drawn_large;
  const uint64_t batches = (count + kLargeSetups - 1) / kLargeSetups, each = (count + batches - 1) / batches;
  const auto warps = uint32_t(blockDim.x / 32), warp = uint32_t(threadIdx.x / 32), lane = uint32_t(threadIdx.x % 32);
  for (uint64_t batch = block % batches; batch < batches; batch += blocks) {
    const auto sharing = batches >= blocks ? 1 : uint32_t((blocks - 1 - batch) / batches + 1);
    const auto part = batches >= blocks ? 0 : uint32_t(block / batches);
    const int here = int(min(count - batch * each, each));
    uint32_t layers = 0;
    if (warp == 0) {
      if (int(lane) < here) {
        const uint32_t t = __ldcg(queue + batch * each + lane);
        if (!IsAmongLargest(args, t)) layers = SetUpLayers(args, t, room.setups[lane]);
      }
      uint32_t total;
      const uint32_t before = WarpExclusiveSum(layers, total);
      if (lane < uint32_t(kLargeSetups)) room.before[lane] = before;
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
