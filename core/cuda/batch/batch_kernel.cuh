// Shared by the kernels of a batch: lookup of the item of a triangle or row, and traversal of triangles. No host-only
// includes.
#pragma once

#include "cuda/batch/batch_views.h"

namespace voxelpipe::cuda {

// Binary search: index of the last element with `first` <= at. Elements with empty ranges are never found.
template <typename T>
__device__ inline uint32_t LastAt(const T* list, uint32_t count, uint64_t T::*first, uint64_t at) {
  uint32_t lo = 0, hi = count;
  while (hi - lo > 1) {
    const uint32_t mid = lo + (hi - lo) / 2;
    if (list[mid].*first <= at) {
      lo = mid;
    } else {
      hi = mid;
    }
  }
  return lo;
}
__device__ inline uint32_t ItemAt(const BatchView& batch, uint64_t BatchItemView::*first, uint64_t at) {
  return LastAt(batch.items, batch.item_count, first, at);
}

// Traversal arguments (triangle_walk.cuh) in which each triangle has the grid and coverage of its item.
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

// Traversal operation (triangle_walk.cuh) that stores the number of triangle t's fragments in counts[t].
struct CountFragments {
  uint32_t* counts = nullptr;
  uint32_t count = 0;

  __device__ static bool repeats() { return false; }
  __device__ void Begin(uint32_t) { count = 0; }
  __device__ void Row(int, int, int x_begin, int x_end) { count += uint32_t(x_end - x_begin); }
  __device__ void End(uint32_t t) const { counts[t] = count; }
  __device__ void Finish() const {}
  // Called after the first kernel, which stored 0 for every deferred triangle.
  __device__ void SharedRow(uint32_t t, int, int, int x_begin, int x_end) const {
    atomicAdd(counts + t, uint32_t(x_end - x_begin));
  }
};

// Traversal of `count` triangles from `first` on, numbered from there.
inline BatchWalkArgs WalkOf(const BatchView& batch, uint64_t first, uint64_t count, BatchQueue queue) {
  BatchWalkArgs args;
  args.items = batch.items;
  args.item_of = batch.item_of + first;
  args.triangles = batch.triangles + 3 * first;
  args.positions = batch.placed;
  args.codes = batch.codes;
  args.triangle_count = count;
  args.small_queue = batch.queue[0];
  args.rest_queue = batch.queue[1];
  args.large_queue = batch.queue[2];
  args.queued = batch.queued + queue;
  return args;
}

}  // namespace voxelpipe::cuda
