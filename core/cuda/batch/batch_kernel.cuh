// What the kernels of a batch share: whose a triangle or a row is, and the walk over triangles. No host-only includes.
#pragma once

#include "cuda/batch/batch_views.h"

namespace voxelpipe::cuda {

// The last of a list whose `first` is not behind `at`: those without any part of their own are never found.
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

// The walk's arguments (triangle_walk.cuh) where each triangle has the grid and the coverage of its item.
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

// An operation of triangle_walk.cuh: counts[t] becomes the number of triangle t's fragments.
struct CountFragments {
  uint32_t* counts = nullptr;
  uint32_t count = 0;

  __device__ static bool repeats() { return false; }
  __device__ void Begin(uint32_t) { count = 0; }
  __device__ void Row(int, int, int x_begin, int x_end) { count += uint32_t(x_end - x_begin); }
  __device__ void End(uint32_t t) const { counts[t] = count; }
  __device__ void Finish() const {}
  // After the first kernel, which left 0 for every triangle that waits.
  __device__ void SharedRow(uint32_t t, int, int, int x_begin, int x_end) const {
    atomicAdd(counts + t, uint32_t(x_end - x_begin));
  }
};

// The walk of `count` triangles from `first` on, which have numbers from there on.
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
