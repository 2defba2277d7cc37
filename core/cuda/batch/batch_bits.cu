// Occupancy bits of a batch: transforms the vertices of all meshes and rasterizes their triangles into the grids.
#include "cuda/batch/batch_bits.cuh"

#include <algorithm>
#include <cstdint>

#include "cuda/batch/batch.h"
#include "cuda/device/launch.cuh"
#include "cuda/traversal/triangle_walk.h"
#include "grid/index_space.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

// First kernel of a batch: clears its bit grids and counters, transforms vertices to the index space of their grids,
// and stores each triangle's item and its vertex indices in the batch.
__global__ void __launch_bounds__(kThreads) PrepareBatch(const __grid_constant__ BatchView batch) {
  const uint64_t me = uint64_t(blockIdx.x) * kThreads + threadIdx.x, threads = uint64_t(gridDim.x) * kThreads;
  for (uint64_t i = me; i < batch.zero_quads; i += threads) static_cast<uint4*>(batch.zero)[i] = uint4{0, 0, 0, 0};
  for (uint64_t i = me; i < batch.vertex_count; i += threads) {
    const BatchItemView& item = batch.items[ItemAt(batch, &BatchItemView::first_vertex, i)];
    const Vec3d p = WorldToIndex(item.grid.space, item.positions[i - item.first_vertex]);
    batch.placed[i] = p;
    batch.codes[i] = EncodeVertex(p);
  }
  for (uint64_t i = me; i < batch.triangle_count; i += threads) {
    const uint32_t number = ItemAt(batch, &BatchItemView::first_triangle, i);
    const BatchItemView& item = batch.items[number];
    batch.item_of[i] = number;
    const uint32_t* const from = item.triangles + 3 * (i - item.first_triangle);
    for (int c = 0; c < 3; ++c) batch.triangles[3 * i + uint64_t(c)] = from[c] + uint32_t(item.first_vertex);
  }
}

}  // namespace

absl::Status RasterBatch(const BatchState& state) {
  const BatchView& batch = state.view;
  const uint64_t work = std::max({batch.zero_quads / 4, batch.vertex_count, batch.triangle_count});
  PrepareBatch<<<BlocksFor(work, kThreads, uint64_t(state.device.multiprocessors) * 16), kThreads, 0, state.stream>>>(
      batch);
  VOXELPIPE_LAUNCHED_OR_RETURN("PrepareBatch");
  const BatchWalkArgs args = WalkOf(batch, 0, batch.row_triangles, kBatchRows);
  return WalkOn(state.device, state.stream, args, SetBatchBits<&BatchItemView::first_word>(args, batch.bits));
}

}  // namespace voxelpipe::cuda
