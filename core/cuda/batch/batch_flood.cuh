// The kernel of a batch's flood fills, and what finds their shells. No host-only includes.
#pragma once

#include "cuda/batch/batch_bits.cuh"
#include "cuda/fill/flood_sweep.cuh"

namespace voxelpipe::cuda {

inline constexpr int kFloodThreads = 512;
// A few rounds of three axes do for most meshes; each turn of a winding passage can take one more. A kernel cannot be
// cancelled: what winds on and on is left to a run alone, which looks at its job after every few.
inline constexpr int kMaxSweeps = 3 * 64;

// The walk's arguments under the shell's coverage, whatever the items'.
struct ShellWalkArgs : BatchWalkArgs {};
__device__ inline Coverage CoverageOf(const ShellWalkArgs&, uint32_t) {
  return Coverage::kConservative;
}

// A block an item. In: shells, nothing inside. Out: inside, or counts[].unfinished.
__global__ void __launch_bounds__(kFloodThreads) FloodKernel(const __grid_constant__ BatchView batch) {
  const uint32_t number = batch.first_flood + blockIdx.x;
  const BatchItemView& item = batch.items[number];
  const uint32_t* const shell = item.own_shell ? batch.shells + item.first_shell : batch.bits + item.first_word;
  // Until the end `inside` has what is reached from outside.
  const FloodView flood = FloodViewOf(item.grid, shell, batch.inside + item.first_word);
  int quiet = 0;  // sweeps one after the other that reached nothing new: three are one of each axis
  for (int sweep = 0; sweep < kMaxSweeps && quiet < 3; ++sweep) {
    const int axis = 2 - sweep % 3;
    const int64_t lines = LinesAlong(flood, axis);
    bool changed = false;
    for (int64_t line = threadIdx.x; line < lines; line += kFloodThreads)
      changed = SweepLine(flood, axis, line) || changed;
    quiet = __syncthreads_or(changed) ? 0 : quiet + 1;
  }
  if (quiet < 3 && threadIdx.x == 0) batch.counts[number].unfinished = 1;
  for (uint64_t i = threadIdx.x; i < item.words; i += kFloodThreads) {
    flood.reached[i] = ~flood.reached[i] & MaskOf(flood, int64_t(i % uint64_t(flood.words)));
  }
}

}  // namespace voxelpipe::cuda
