// Segmented reduction over adjacent spans of the same voxels, which are frequent for small triangles. No host-only
// includes.
#pragma once

#include "cuda/primitives/span.h"
#include "cuda/traversal/row_traversal.cuh"

namespace voxelpipe::cuda {

// A segment of adjacent lanes whose spans cover the same voxels. Its first lane blends for all.
struct LaneRun {
  uint32_t heads;   // mask of the first lanes of segments
  int first, last;  // lanes of this lane's segment
  __device__ bool head() const { return first == int(threadIdx.x % 32); }
};
// Finds the segments. All 32 lanes call it.
__device__ inline LaneRun FindRun(uint64_t span) {
  const uint64_t key = span & ((uint64_t{1} << 37) - 1), left = __shfl_up_sync(~0u, key, 1);
  const unsigned lane = threadIdx.x % 32;
  LaneRun run;
  run.heads = __ballot_sync(~0u, lane == 0 || left != key);
  const uint32_t upto = (2u << lane) - 1;
  run.first = 31 - __clz(int(run.heads & upto));
  run.last = (run.heads & ~upto) == 0 ? 31 : __ffs(int(run.heads & ~upto)) - 2;
  return run;
}
// Reduces the values of each segment into its first lane. All 32 lanes call it.
template <typename T, typename Combine>
__device__ inline T CombineRun(const LaneRun& run, T value, Combine&& combine) {
  uint32_t longer = ~run.heads;  // the run length of ones is the longest segment - 1
  for (int step = 1; longer != 0; longer &= longer << step, step *= 2) {
    const T other = __shfl_down_sync(~0u, value, unsigned(step));
    if (int(threadIdx.x % 32) + step <= run.last) value = combine(value, other);
  }
  return value;
}

// Distributes the voxels of all lanes' spans over lanes, so that accesses to neighbours in a row coalesce. Calls
// visit(lane of the span, voxel's offset in it, true if there is a voxel). All 32 lanes call it, and all call visit
// together.
template <typename Visit>
__device__ inline void ForEachVoxel(uint32_t length, Visit&& visit) {
  uint32_t total;
  const uint32_t before = WarpExclusiveSum(length, total);
  for (uint32_t first = 0; first < total; first += 32) {
    const uint32_t item = first + threadIdx.x % 32;
    const int owner = LaneOfItem(before, item);
    visit(owner, item - __shfl_sync(~0u, before, owner), item < total);
  }
}

}  // namespace voxelpipe::cuda
