// What the kernels of a batch share: who a triangle or a row belongs to. No host-only includes.
#pragma once

#include "cuda/batch_views.h"

namespace voxelpipe::cuda {

// The last item whose `first` is not behind `at`: items without any part of their own are never found.
__device__ inline uint32_t ItemAt(const BatchView& batch, uint64_t BatchItemView::*first, uint64_t at) {
  uint32_t lo = 0, hi = batch.item_count;
  while (hi - lo > 1) {
    const uint32_t mid = lo + (hi - lo) / 2;
    if (batch.items[mid].*first <= at) {
      lo = mid;
    } else {
      hi = mid;
    }
  }
  return lo;
}

// The walk's arguments (walk_kernels.cuh) where each triangle has the grid and the coverage of its item.
struct BatchWalkArgs {
  const BatchItemView* items = nullptr;
  const uint32_t* item_of = nullptr;
  const uint32_t* triangles = nullptr;
  const Vec3d* positions = nullptr;
  const VertexCode* codes = nullptr;
  uint64_t triangle_count = 0;
  uint32_t *small_queue = nullptr, *rest_queue = nullptr, *large_queue = nullptr;
  uint64_t* queued = nullptr;
};
__device__ inline const GridView& GridOf(const BatchWalkArgs& args, uint32_t t) {
  return args.items[args.item_of[t]].grid;
}
__device__ inline Coverage CoverageOf(const BatchWalkArgs& args, uint32_t t) {
  return args.items[args.item_of[t]].coverage;
}

}  // namespace voxelpipe::cuda
