// The kernel of the fine raster for a batch: every tile has the shaders, targets and mesh of its item. No host-only
// includes.
#pragma once

#include "cuda/batch/batch_kernel.cuh"
#include "cuda/tiles/fine_raster_kernel.cuh"

namespace voxelpipe::cuda {

// Persistent blocks, as FineRasterKernel. A launch blends group number `group` of each item.
__global__ void __launch_bounds__(kFineThreads, 2)
    FineBatchKernel(const __grid_constant__ BatchView batch, const __grid_constant__ BatchPairs pairs, uint32_t group) {
  extern __shared__ uint64_t shared_memory[];
  auto* const shared = reinterpret_cast<uint32_t*>(shared_memory);
  __shared__ uint32_t touched[kTileRows], covered[kTileRows], queue[kFineThreads], queued;
  __shared__ uint64_t number;
  const auto thread = int(threadIdx.x);
  const uint64_t count = batch.counters[kBatchOccupied];
  if (thread == 0) queued = 0;
  for (;;) {
    __syncthreads();
    if (thread == 0)
      number = atomicAdd(reinterpret_cast<unsigned long long*>(batch.counters + kBatchNextTile + group), 1ull);
    __syncthreads();
    if (number >= count) break;
    const uint32_t tile = pairs.occupied[number];
    const uint32_t item_number = ItemAt(batch, &BatchItemView::first_tile, tile);
    const BatchItemView& item = batch.items[item_number];
    if (group >= item.group_count) continue;
    const FineArgs& args = batch.groups[item.first_group + group];
    const VoxelRange whole = TileVoxels(args.grid.tiles, tile - item.first_tile, args.grid.dims);
    if (thread < kTileRows) touched[thread] = covered[thread] = 0;
    for (int t = 0; t < args.target_count; ++t) BeginTile(args.targets[t], shared, thread, kFineThreads);
    __syncthreads();
    uint64_t fragments = 0;
    for (int pass = 0; pass < (args.has_owners ? 2 : 1); ++pass) {
      RasterTile<true>(args, pairs.triangles, shared, pass, whole, pairs.begin[tile], pairs.end[tile], touched, covered,
                       queue, &queued, fragments);
    }
    StoreTile(args, shared, whole, touched, covered, 0);
    if (group == 0) AddFragments(fragments, &batch.counts[item_number].fragments);
  }
}

}  // namespace voxelpipe::cuda
