// Segmented reduction over adjacent lanes whose triangles touch voxels around the same grid corner, which is frequent
// in meshes. No host-only includes.
#pragma once

#include "cuda/traversal/row_traversal.cuh"

namespace voxelpipe::cuda {

// Shared memory of a warp: the inputs of its lanes.
template <typename T, int kComponents>
struct alignas(16) CellRunRoom {
  T value[32][kComponents];
  uint32_t first[32];
  uint8_t begin[33];
};

// The combined value of one voxel of a segment.
template <typename T, int kComponents>
struct OctantOfRun {
  uint32_t first;   // first voxel of the segment's 2x2x2 mask, as passed in
  int octant;       // the voxel of this lane, 0 to 7
  uint32_t count;   // triangles that touch it; 0: nothing to do
  uint32_t beside;  // triangles that touch the next voxel, in the next lane
  T value[kComponents];
};

// Each lane passes the first voxel of a 2x2x2 mask, the mask, and a value. Adjacent lanes with the same first voxel
// form a segment. For each voxel of a segment, values are reduced by combine(kept, value) and passed to
// emit(OctantOfRun): eight lanes per segment, four segments at a time. All 32 lanes call it, and all call emit
// together.
template <typename T, int kComponents, typename Combine, typename Emit>
__device__ inline void CombineRuns(CellRunRoom<T, kComponents>& room, uint32_t first, uint32_t octants,
                                   const T (&value)[kComponents], Combine&& combine, Emit&& emit) {
  const unsigned lane = threadIdx.x % 32;
  if (__ballot_sync(~0u, octants != 0) == 0) return;
  const uint32_t left = __shfl_up_sync(~0u, first, 1);
  const bool head = lane == 0 || left != first;
  const unsigned heads = __ballot_sync(~0u, head);
  const int runs = __popc(heads), octant = int(lane % 8);
  uint32_t touching = 0;  // mask of lanes whose triangles touch this lane's voxel of their own 2x2x2 mask
#pragma unroll
  for (int k = 0; k < 8; ++k) {
    const uint32_t lanes = __ballot_sync(~0u, (octants >> k & 1) != 0);
    if (octant == k) touching = lanes;
  }
  __syncwarp();  // the shared memory is free
  room.first[lane] = first;
#pragma unroll
  for (int c = 0; c < kComponents; ++c) room.value[lane][c] = value[c];
  if (head) room.begin[__popc(heads & ((1u << lane) - 1))] = uint8_t(lane);
  if (lane == 0) room.begin[runs] = 32;
  __syncwarp();
  for (int begins = 0; begins < runs; begins += 4) {
    const int run = begins + int(lane / 8);
    OctantOfRun<T, kComponents> of{};
    of.octant = octant;
    if (run < runs) {
      const uint32_t begin = room.begin[run], end = room.begin[run + 1];
      of.first = room.first[begin];
      uint32_t left_over = touching & (~0u >> (32 - end)) & ~((1u << begin) - 1);
      of.count = uint32_t(__popc(left_over));
      if (left_over != 0) {
        int i = __ffs(int(left_over)) - 1;
#pragma unroll
        for (int c = 0; c < kComponents; ++c) of.value[c] = room.value[i][c];
        while ((left_over &= left_over - 1) != 0) {
          i = __ffs(int(left_over)) - 1;
#pragma unroll
          for (int c = 0; c < kComponents; ++c) of.value[c] = combine(of.value[c], room.value[i][c]);
        }
      }
    }
    of.beside = __shfl_down_sync(~0u, of.count, 1);
    emit(of);
  }
}

// Reduces each lane's mask to the voxels that no later lane of its segment touches (`last`; otherwise no earlier one):
// all that must be blended by a max or min of values that are monotonic in the lane. All 32 lanes call it.
__device__ inline uint32_t OctantsAlone(uint32_t first, uint32_t octants, bool last) {
  const unsigned lane = threadIdx.x % 32;
  const uint32_t left = __shfl_up_sync(~0u, first, 1);
  const uint32_t heads = __ballot_sync(~0u, lane == 0 || left != first), upto = (2u << lane) - 1;
  uint32_t others;
  if (last) {
    const uint32_t next = heads & ~upto;
    const unsigned end = next == 0 ? 32 : unsigned(__ffs(int(next))) - 1;
    const auto from = [&](uint32_t value, unsigned step) {
      const uint32_t there = __shfl_down_sync(~0u, value, step);
      return lane + step < end ? there : 0;
    };
    others = from(octants, 1);
#pragma unroll
    for (unsigned step = 1; step < 32; step *= 2) others |= from(others, step);
  } else {
    const unsigned begin = 31 - unsigned(__clz(int(heads & upto)));
    const auto from = [&](uint32_t value, unsigned step) {
      const uint32_t there = __shfl_up_sync(~0u, value, step);
      return lane >= begin + step ? there : 0;
    };
    others = from(octants, 1);
#pragma unroll
    for (unsigned step = 1; step < 32; step *= 2) others |= from(others, step);
  }
  return octants & ~others;
}

}  // namespace voxelpipe::cuda
