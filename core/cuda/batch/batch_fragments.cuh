// Kernels of a batch's A-buffers: fragments of all items are in one list, with voxel numbers in one index space. No
// host-only includes.
#pragma once

#include "cuda/batch/batch_kernel.cuh"
#include "cuda/shading/fragment_shading.cuh"
#include "cuda/traversal/triangle_walk.cuh"

namespace voxelpipe::cuda {

// Traversal operation that writes each fragment's voxel (numbered over all items) and triangle (within its mesh), from
// first[t] on for triangle t.
struct EmitFragment {
  const BatchItemView* items = nullptr;
  const uint32_t* item_of = nullptr;  // per triangle of the traversal
  uint64_t first_triangle = 0;        // of the traversal
  const uint64_t* first = nullptr;
  uint32_t* emitted = nullptr;  // per triangle, 0 before: number of fragments emitted by threads that share it
  uint32_t* keys = nullptr;
  uint32_t* values = nullptr;
  uint64_t at = 0;
  uint32_t triangle = 0;

  __device__ static bool repeats() { return true; }
  __device__ void Begin(uint32_t t) {
    triangle = t;
    at = first[t];
  }
  __device__ void Row(int y, int z, int x_begin, int x_end) { at = Put(at, triangle, y, z, x_begin, x_end); }
  __device__ void End(uint32_t) const {}
  __device__ void Finish() const {}
  __device__ void SharedRow(uint32_t t, int y, int z, int x_begin, int x_end) const {
    Put(first[t] + atomicAdd(emitted + t, uint32_t(x_end - x_begin)), t, y, z, x_begin, x_end);
  }

 private:
  __device__ uint64_t Put(uint64_t to, uint32_t t, int y, int z, int x_begin, int x_end) const {
    const BatchItemView& item = items[item_of[t]];
    const uint64_t row = item.first_voxel + uint64_t(item.grid.dims[0]) * uint64_t(y + item.grid.dims[1] * z);
    const auto of_mesh = uint32_t(first_triangle + t - item.first_triangle);
    for (int x = x_begin; x < x_end; ++x, ++to) {
      keys[to] = uint32_t(row + uint64_t(x));
      values[to] = of_mesh;
    }
    return to;
  }
};

// The first emission kernel: emits runs, as in WalkRuns. The queues are filled already.
__global__ void __launch_bounds__(kRunThreads) EmitRuns(const __grid_constant__ BatchWalkArgs args, EmitFragment op) {
  const uint64_t t = uint64_t(blockIdx.x) * kRunThreads + threadIdx.x;
  if (t >= args.triangle_count) return;
  const CodedBox box = LoadBox(args.codes, LoadCorners(args.triangles, t));
  Box32 range;
  if (box.far || !IsRun(box, CoverageOf(args, uint32_t(t))) || !Clip(box, SlabBox(GridOf(args, uint32_t(t))), range) ||
      range.rows() > kRowsOfRun) {
    return;
  }
  op.Begin(uint32_t(t));
  for (int z = range.begin[2]; z < range.end[2]; ++z) {
    for (int y = range.begin[1]; y < range.end[1]; ++y) op.Row(y, z, range.begin[0], range.end[0]);
  }
}

__device__ inline FragmentShading ShadingOf(const BatchView& batch, const BatchItemView& item) {
  FragmentShading shading;
  shading.grid = &item.grid;
  shading.mesh = item.shading.mesh;
  shading.targets = batch.shaded + item.shading.first_target;
  shading.target_count = item.shading.target_count;
  shading.traits = item.shading.traits;
  shading.planar = item.shading.planar;
  shading.first_key = item.first_voxel;
  return shading;
}

// Moves fragments that all targets of their item discard to the voxel number past the last one, so that they are sorted
// to the end. One thread per fragment.
__global__ void __launch_bounds__(256)
    DropFragments(const __grid_constant__ BatchView batch, uint32_t* keys, const uint32_t* triangles, uint64_t count) {
  for (uint64_t i = uint64_t(blockIdx.x) * 256 + threadIdx.x; i < count; i += uint64_t(gridDim.x) * 256) {
    const BatchItemView& item = batch.items[ItemAt(batch, &BatchItemView::first_voxel, keys[i])];
    if (!item.shading.drops) continue;
    FragmentShading shading = ShadingOf(batch, item);
    shading.keys = keys;
    shading.triangles = triangles;
    if (!IsKept(shading, i)) keys[i] = uint32_t(batch.voxel_count);
  }
}

// found[k]: first sorted fragment of item first_item + k; then the end of the last item, where discarded fragments
// begin; then *voxels, the number of voxels that have fragments.
__global__ void __launch_bounds__(256)
    FindItems(const __grid_constant__ BatchView batch, uint32_t first_item, const uint32_t* keys, uint64_t count,
              const uint64_t* voxels, uint64_t* found) {
  const uint32_t k = blockIdx.x * 256 + threadIdx.x, items = batch.item_count - first_item;
  if (k == items + 1) found[k] = *voxels;
  if (k > items) return;
  const uint64_t voxel = k == items ? batch.voxel_count : batch.items[first_item + k].first_voxel;
  uint64_t lo = 0, hi = count;
  while (lo < hi) {
    const uint64_t mid = lo + (hi - lo) / 2;
    if (keys[mid] < voxel) {
      lo = mid + 1;
    } else {
      hi = mid;
    }
  }
  found[k] = lo;
}

// Threads are assigned to ranges in whole warps.
__global__ void __launch_bounds__(256)
    ShadeBatchFragments(const __grid_constant__ BatchView batch, const __grid_constant__ BatchShadeArgs args) {
  for (uint64_t i = uint64_t(blockIdx.x) * 256 + threadIdx.x; i < args.threads; i += uint64_t(gridDim.x) * 256) {
    const BatchFragmentRange& range =
        args.ranges[LastAt(args.ranges, args.range_count, &BatchFragmentRange::first_thread, i)];
    const BatchItemView& item = batch.items[range.item];
    FragmentShading shading = ShadingOf(batch, item);
    shading.keys = args.keys + range.first;
    shading.triangles = args.triangles + range.first;
    shading.count = range.count;
    shading.out = args.out + item.shading.first_target;
    WriteValues(shading, i - range.first_thread);
  }
}

}  // namespace voxelpipe::cuda
