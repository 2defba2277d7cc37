// Counting and emitting of the A-buffer's fragments: operations of triangle_walk.cuh. No host-only includes: NVRTC
// compiles them too.
#pragma once

#include "cuda/traversal/triangle_walk.cuh"

namespace voxelpipe::cuda {

// counts[t] becomes the number of triangle t's fragments.
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

// What a fragment's voxel and triangle are called: here the voxel's index within the slab. A batch has its own
// (batch_fragments.cuh).
struct SlabNames {
  GridView grid;

  __device__ uint64_t Row(uint32_t, int y, int z) const {  // of its first voxel
    return uint64_t(grid.dims[0]) * uint64_t(y + grid.dims[1] * (z - grid.slab_begin));
  }
  __device__ uint32_t Triangle(uint32_t t) const { return t; }
};

// Writes each fragment's voxel and triangle, a triangle's from first[t] on.
template <typename Key, typename Names = SlabNames>
struct EmitFragment {
  Names names;
  const uint64_t* first = nullptr;
  uint32_t* emitted = nullptr;  // per triangle, 0 before: fragments that several threads have emitted
  Key* keys = nullptr;
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
    const uint64_t row = names.Row(t, y, z);
    const uint32_t name = names.Triangle(t);
    for (int x = x_begin; x < x_end; ++x, ++to) {
      keys[to] = Key(row + uint64_t(x));
      values[to] = name;
    }
    return to;
  }
};

// The first kernel of an emission: runs as in WalkRuns, whose queues stand already.
template <typename Op, typename Args = WalkArgs>
__global__ void __launch_bounds__(kRunThreads) EmitRuns(const __grid_constant__ Args args, Op op) {
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

}  // namespace voxelpipe::cuda
