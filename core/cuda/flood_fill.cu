// Flood fill: what a 6-connected walk from outside the grid cannot reach without entering the conservative shell.
//
// Sweeps along the three axes, forward and back, on words of 32 voxels: a sweep carries what is reached as far along its axis as it is
// open. They are repeated until none reaches anything new, which straight passages let happen after a few.
#include <algorithm>

#include "cuda/launch.h"
#include "cuda/run_state.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 128;

struct SweepArgs {
  const uint32_t* shell;
  uint32_t* reached;
  int64_t words, ny, nz;  // words a row
  uint32_t last_mask;     // the voxels of a row's last word
  int last_bit;           // the last voxel in it
  uint64_t* changed;
};

// Spreads `reached` along the open voxels of its word, both ways.
__device__ inline uint32_t SpreadInWord(uint32_t reached, uint32_t open) {
  uint32_t up = reached & open, down = up, up_open = open, down_open = open;
  for (int step = 1; step < 32; step *= 2) {
    up |= up_open & (up << step);
    up_open &= up_open << step;
    down |= down_open & (down >> step);
    down_open &= down_open >> step;
  }
  return up | down;
}

// Adds seeds to word `at`; what it then holds.
__device__ inline uint32_t Grow(const SweepArgs& args, int64_t at, int64_t w, uint32_t seeds, bool& changed) {
  const uint32_t open = ~args.shell[at] & (w + 1 == args.words ? args.last_mask : ~0u);
  const uint32_t before = args.reached[at];
  if ((seeds & open & ~before) == 0) return before;
  const uint32_t now = SpreadInWord(before | seeds, open);
  args.reached[at] = now;
  changed = true;
  return now;
}

__device__ inline void Report(const SweepArgs& args, bool changed) {
  if (__syncthreads_or(changed) && threadIdx.x == 0) {
    atomicAdd(reinterpret_cast<unsigned long long*>(args.changed), 1ull);
  }
}

// Along y (axis 1) or z (axis 2): a thread a line of words. The layer around the grid is reached.
__global__ void __launch_bounds__(kThreads) SweepAcross(const SweepArgs args, int axis) {
  const int64_t i = int64_t(blockIdx.x) * kThreads + threadIdx.x;
  const int64_t across = axis == 1 ? args.nz : args.ny, length = axis == 1 ? args.ny : args.nz;
  bool changed = false;
  if (i < args.words * across) {
    const int64_t w = i % args.words, other = i / args.words;
    const int64_t step = axis == 1 ? args.words : args.words * args.ny;
    const int64_t start = w + (axis == 1 ? other * args.ny * args.words : other * args.words);
    uint32_t carry = ~0u;
    for (int64_t k = 0; k < length; ++k) carry = Grow(args, start + k * step, w, carry, changed);
    carry = ~0u;
    for (int64_t k = length; k-- > 0;) carry = Grow(args, start + k * step, w, carry, changed);
  }
  Report(args, changed);
}

// Along x: a thread a row.
__global__ void __launch_bounds__(kThreads) SweepAlong(const SweepArgs args) {
  const int64_t row = int64_t(blockIdx.x) * kThreads + threadIdx.x;
  bool changed = false;
  if (row < args.ny * args.nz) {
    const int64_t start = row * args.words;
    uint32_t carry = 1;
    for (int64_t w = 0; w < args.words; ++w) carry = Grow(args, start + w, w, carry, changed) >> 31;
    carry = 1u << args.last_bit;
    for (int64_t w = args.words; w-- > 0;) carry = (Grow(args, start + w, w, carry, changed) & 1) << 31;
  }
  Report(args, changed);
}

__global__ void __launch_bounds__(kThreads)
    Invert(const uint32_t* outside, uint32_t* inside, uint64_t count, int64_t words, uint32_t last_mask) {
  for (uint64_t i = uint64_t(blockIdx.x) * kThreads + threadIdx.x; i < count; i += uint64_t(gridDim.x) * kThreads) {
    inside[i] = ~outside[i] & (int64_t(i % uint64_t(words)) + 1 == words ? last_mask : ~0u);
  }
}

// Of the whole grid, whatever the slab: a walk knows no slabs.
absl::Status FindOutside(RunState& state, SweepArgs args) {
  const uint64_t words = uint64_t(args.words) * uint64_t(args.ny) * uint64_t(args.nz);
  DeviceArray<uint32_t> shell;
  VOXELPIPE_OK_OR_RETURN(shell.Resize(words, state.stream));
  VOXELPIPE_OK_OR_RETURN(RasterRows(state, Coverage::kConservative, 0, args.nz, shell.data(), words));
  VOXELPIPE_OK_OR_RETURN(state.outside.Resize(words, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.outside.Fill(0, state.stream));
  args.shell = shell.data();
  args.reached = state.outside.data();
  args.changed = state.counters.data() + kChanged;
  for (;;) {
    VOXELPIPE_OK_OR_RETURN(state.job.Check());
    VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kChanged}));
    for (int round = 0; round < 2; ++round) {
      SweepAcross<<<BlocksFor(uint64_t(args.words * args.ny), kThreads, UINT32_MAX), kThreads, 0, state.stream>>>(args,
                                                                                                                  2);
      VOXELPIPE_LAUNCHED_OR_RETURN("SweepAcross");
      SweepAcross<<<BlocksFor(uint64_t(args.words * args.nz), kThreads, UINT32_MAX), kThreads, 0, state.stream>>>(args,
                                                                                                                  1);
      VOXELPIPE_LAUNCHED_OR_RETURN("SweepAcross");
      if (round == 1) VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kChanged}));
      SweepAlong<<<BlocksFor(uint64_t(args.ny * args.nz), kThreads, UINT32_MAX), kThreads, 0, state.stream>>>(args);
      VOXELPIPE_LAUNCHED_OR_RETURN("SweepAlong");
    }
    // A last round of all three axes that changes nothing ends the walk.
    SweepAcross<<<BlocksFor(uint64_t(args.words * args.ny), kThreads, UINT32_MAX), kThreads, 0, state.stream>>>(args,
                                                                                                                2);
    VOXELPIPE_LAUNCHED_OR_RETURN("SweepAcross");
    SweepAcross<<<BlocksFor(uint64_t(args.words * args.nz), kThreads, UINT32_MAX), kThreads, 0, state.stream>>>(args,
                                                                                                                1);
    VOXELPIPE_LAUNCHED_OR_RETURN("SweepAcross");
    const auto counters = ReadCounters(state);
    if (!counters.ok()) return counters.status();
    if ((*counters)[kChanged] == 0) return absl::OkStatus();
  }
}

}  // namespace

absl::Status FloodInside(RunState& state) {
  SweepArgs args{};
  args.words = state.view.words_per_row;
  args.ny = state.view.dims[1];
  args.nz = state.view.dims[2];
  const int rest = int(state.view.dims[0] % 32);
  args.last_mask = rest == 0 ? ~0u : (1u << rest) - 1;
  args.last_bit = rest == 0 ? 31 : rest - 1;
  if (state.outside.empty()) {
    if (absl::Status s = FindOutside(state, args); !s.ok()) {
      state.outside.Free();  // it is not done
      return s;
    }
  }
  const uint64_t first = uint64_t(state.slab.begin) * uint64_t(args.ny) * uint64_t(args.words);
  const uint64_t count = state.slab_words();
  Invert<<<BlocksFor(count, kThreads), kThreads, 0, state.stream>>>(state.outside.data() + first, state.inside.data(),
                                                                    count, args.words, args.last_mask);
  VOXELPIPE_LAUNCHED_OR_RETURN("Invert");
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
