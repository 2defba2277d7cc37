// Kernel of a batch's flood fills, and traversal of their shells. No host-only includes.
#pragma once

#include "cuda/batch/batch_bits.cuh"
#include "cuda/fill/flood_sweep.cuh"

namespace voxelpipe::cuda {

inline constexpr int kFloodThreads = 512;
// Most meshes need a few rounds of three axes; each bend of a winding passage can need one more. A kernel cannot be
// cancelled, so an item that needs more sweeps is run alone, where the job is checked every few sweeps.
inline constexpr int kMaxSweeps = 3 * 64;

// Traversal arguments with the coverage of shells, whatever the coverage of the items.
struct ShellWalkArgs : BatchWalkArgs {};
__device__ inline Coverage CoverageOf(const ShellWalkArgs&, uint32_t) {
  return Coverage::kConservative;
}

// One block per item. Input: shells, and cleared inside grids. Output: inside voxels, or counts[].unfinished.
__global__ void __launch_bounds__(kFloodThreads) FloodKernel(const __grid_constant__ BatchView batch) {
  const uint32_t number = batch.first_flood + blockIdx.x;
  const BatchItemView& item = batch.items[number];
  const uint32_t* const shell = item.own_shell ? batch.shells + item.first_shell : batch.bits + item.first_word;
  // During the sweeps `inside` has the voxels reached from outside.
  const FloodView flood = FloodViewOf(item.grid, shell, batch.inside + item.first_word);
  int quiet = 0;  // consecutive sweeps that reached nothing new; three cover all axes
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
