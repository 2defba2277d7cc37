// Triangles that touch voxels about one corner, neighbours in a list: those of a mesh often do. No host-only includes.
#pragma once

#include "cuda/traversal/row_traversal.cuh"

namespace voxelpipe::cuda {

// What the lanes of a warp bring; in shared memory, one a warp.
template <typename T, int kComponents>
struct alignas(16) CellRunRoom {
  T value[32][kComponents];
  uint32_t first[32];
  uint8_t begin[33];
};

// What is combined for an octant of a run.
template <typename T, int kComponents>
struct OctantOfRun {
  uint32_t first;   // of the run, as the lanes brought it
  int octant;       // this lane's
  uint32_t count;   // triangles that touch it; 0: nothing to do
  uint32_t beside;  // triangles that touch the next octant, in the next lane
  T value[kComponents];
};

// Each lane brings the voxel of a corner, the octants about it that its triangle touches, and a value. Lanes in a row
// with one corner are a run: combine(kept, value) is done for each of its octants, then emit(OctantOfRun) is called: by
// eight lanes for the octants of a run, four runs at a time. All 32 lanes call it, and all call emit together.
template <typename T, int kComponents, typename Combine, typename Emit>
__device__ inline void CombineRuns(CellRunRoom<T, kComponents>& room, uint32_t first, uint32_t octants,
                                   const T (&value)[kComponents], Combine&& combine, Emit&& emit) {
  const unsigned lane = threadIdx.x % 32;
  if (__ballot_sync(~0u, octants != 0) == 0) return;
  const uint32_t left = __shfl_up_sync(~0u, first, 1);
  const bool head = lane == 0 || left != first;
  const unsigned heads = __ballot_sync(~0u, head);
  const int runs = __popc(heads), octant = int(lane % 8);
  uint32_t touching = 0;  // lanes whose triangles touch this lane's octant of their own corner
#pragma unroll
  for (int k = 0; k < 8; ++k) {
    const uint32_t lanes = __ballot_sync(~0u, (octants >> k & 1) != 0);
    if (octant == k) touching = lanes;
  }
  __syncwarp();  // the room is free
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

// Of the octants that a lane's triangle touches, those that no later lane of its run (`last`), or no earlier one,
// touches: all that are to be blended where the largest of values that grow, or fall, from lane to lane is sought. All
// 32 lanes call it.
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
