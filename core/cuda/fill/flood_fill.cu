// Flood fill: the voxels that a 6-connected fill from outside the grid cannot reach without entering the conservative
// shell.
//
// Sweeps along the three axes, forward and backward, on words of 32 voxels. A sweep propagates reached voxels along its
// axis until a closed voxel. Sweeps repeat until none reaches anything new; without winding passages a few suffice.
#include <iterator>

#include "cuda/device/launch.cuh"
#include "cuda/fill/flood_sweep.cuh"
#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 128;

__global__ void __launch_bounds__(kThreads) SweepKernel(const FloodView flood, int axis, uint64_t* changed) {
  const int64_t line = int64_t(blockIdx.x) * kThreads + threadIdx.x;
  const bool reached = line < LinesAlong(flood, axis) && SweepLine(flood, axis, line);
  if (__syncthreads_or(reached) && threadIdx.x == 0) {
    atomicAdd(reinterpret_cast<unsigned long long*>(changed), 1ull);
  }
}

__global__ void __launch_bounds__(kThreads)
    Invert(const FloodView flood, uint64_t first, uint64_t count, uint32_t* inside) {
  for (uint64_t i = uint64_t(blockIdx.x) * kThreads + threadIdx.x; i < count; i += uint64_t(gridDim.x) * kThreads) {
    inside[i] = ~flood.reached[first + i] & MaskOf(flood, int64_t(i % uint64_t(flood.words)));
  }
}

// For the whole grid, not the slab: connectivity does not stop at slab borders.
absl::Status FindOutside(RunState& state) {
  const uint64_t words = uint64_t(state.view.words_per_row) * uint64_t(state.view.dims[1] * state.view.dims[2]);
  DeviceArray<uint32_t> shell;
  VOXELPIPE_OK_OR_RETURN(shell.Resize(words, state.stream));
  VOXELPIPE_OK_OR_RETURN(RasterRows(state, Coverage::kConservative, 0, state.view.dims[2], shell.data(), words));
  VOXELPIPE_OK_OR_RETURN(state.outside.Resize(words, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.outside.Fill(0, state.stream));
  const FloodView flood = FloodViewOf(state.view, shell.data(), state.outside.data());
  constexpr int kAxes[] = {2, 1, 0, 2, 1, 0, 2, 1};
  for (;;) {
    VOXELPIPE_OK_OR_RETURN(state.job.Check());
    for (size_t i = 0; i < std::size(kAxes); ++i) {
      // A last round of all three axes that changes nothing ends the fill.
      if (i + 3 == std::size(kAxes)) VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kChanged}));
      const unsigned blocks = BlocksFor(uint64_t(LinesAlong(flood, kAxes[i])), kThreads, UINT32_MAX);
      SweepKernel<<<blocks, kThreads, 0, state.stream>>>(flood, kAxes[i], state.counters.data() + kChanged);
      VOXELPIPE_LAUNCHED_OR_RETURN("SweepKernel");
    }
    const auto counters = ReadCounters(state);
    if (!counters.ok()) return counters.status();
    if ((*counters)[kChanged] == 0) return absl::OkStatus();
  }
}

}  // namespace

absl::Status FloodInside(RunState& state) {
  if (state.outside.empty()) {
    if (absl::Status s = FindOutside(state); !s.ok()) {
      state.outside.Free();  // incomplete
      return s;
    }
  }
  const FloodView flood = FloodViewOf(state.view, nullptr, state.outside.data());
  const uint64_t first = uint64_t(state.slab.begin) * uint64_t(flood.ny) * uint64_t(flood.words);
  const uint64_t count = state.slab_words();
  Invert<<<BlocksFor(count, kThreads), kThreads, 0, state.stream>>>(flood, first, count, state.inside.data());
  VOXELPIPE_LAUNCHED_OR_RETURN("Invert");
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
