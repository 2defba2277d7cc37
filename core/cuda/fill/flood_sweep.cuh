// Sweeps of the flood fill (flood_fill.cu) along lines of a grid, one thread per line. No host-only includes.
#pragma once

#include "cuda/primitives/views.h"
#include "grid/word_spread.h"

namespace voxelpipe::cuda {

// Bit grids of a whole grid, with the rows of GridView.
struct FloodView {
  const uint32_t* shell = nullptr;    // closed voxels
  uint32_t* reached = nullptr;        // open voxels reached from outside so far
  int64_t words = 1, ny = 1, nz = 1;  // words per row
  uint32_t last_mask = ~0u;           // valid voxels of a row's last word
  int last_bit = 31;                  // the last of them
};

VOXELPIPE_HD FloodView FloodViewOf(const GridView& grid, const uint32_t* shell, uint32_t* reached) {
  FloodView flood;
  flood.shell = shell;
  flood.reached = reached;
  flood.words = grid.words_per_row;
  flood.ny = grid.dims[1];
  flood.nz = grid.dims[2];
  const int rest = int(grid.dims[0] % 32);
  flood.last_mask = rest == 0 ? ~0u : (1u << rest) - 1;
  flood.last_bit = rest == 0 ? 31 : rest - 1;
  return flood;
}

// The valid voxels of word `w` of a row.
__device__ inline uint32_t MaskOf(const FloodView& flood, int64_t w) {
  return w + 1 == flood.words ? flood.last_mask : ~0u;
}

// Propagates along `length` words, `step` apart, starting outside. `mask`: the valid voxels of the words. True if
// anything new is reached.
__device__ inline bool SweepWords(const FloodView& flood, int64_t at, int64_t step, int64_t length, uint32_t mask) {
  constexpr int kAhead = 8;  // words loaded together, to overlap their latencies
  bool changed = false;
  uint32_t carry = ~0u;
  for (int64_t k = 0; k < length; k += kAhead) {
    uint32_t open[kAhead], before[kAhead];
#pragma unroll
    for (int i = 0; i < kAhead; ++i) {
      const bool here = k + i < length;
      open[i] = here ? ~flood.shell[at + (k + i) * step] & mask : 0;
      before[i] = here ? flood.reached[at + (k + i) * step] : 0;
    }
#pragma unroll
    for (int i = 0; i < kAhead; ++i) {
      const uint32_t seeds = carry & open[i] & ~before[i];
      carry = before[i];
      if (seeds == 0) continue;
      carry = SpreadInWord(before[i] | seeds, open[i]);
      flood.reached[at + (k + i) * step] = carry;
      changed = true;
    }
  }
  return changed;
}

// Adds seeds to word `w` of a row, at index `at` of the grid. Returns its new value.
__device__ inline uint32_t Grow(const FloodView& flood, int64_t at, int64_t w, uint32_t seeds, bool& changed) {
  const uint32_t open = ~flood.shell[at] & MaskOf(flood, w), before = flood.reached[at];
  if ((seeds & open & ~before) == 0) return before;
  changed = true;
  return flood.reached[at] = SpreadInWord(before | seeds, open);
}

// A sweep: all lines along an axis, 0 to 2, forward and backward. Lines are independent.
VOXELPIPE_HD int64_t LinesAlong(const FloodView& flood, int axis) {
  if (axis == 0) return flood.ny * flood.nz;
  return flood.words * (axis == 1 ? flood.nz : flood.ny);
}
// Processes line `line` of a sweep. The layer around the grid counts as reached. True if anything new is reached.
__device__ inline bool SweepLine(const FloodView& flood, int axis, int64_t line) {
  if (axis == 0) {
    const int64_t start = line * flood.words;
    bool changed = false;
    uint32_t carry = 1;
    for (int64_t w = 0; w < flood.words; ++w) carry = Grow(flood, start + w, w, carry, changed) >> 31;
    carry = 1u << flood.last_bit;
    for (int64_t w = flood.words; w-- > 0;) carry = (Grow(flood, start + w, w, carry, changed) & 1) << 31;
    return changed;
  }
  const int64_t layer = flood.words * flood.ny, other = line / flood.words, w = line - other * flood.words;
  const int64_t step = axis == 1 ? flood.words : layer, length = axis == 1 ? flood.ny : flood.nz;
  const int64_t first = w + other * (axis == 1 ? layer : flood.words), last = first + (length - 1) * step;
  const uint32_t mask = MaskOf(flood, w);
  const bool up = SweepWords(flood, first, step, length, mask);
  return SweepWords(flood, last, -step, length, mask) || up;
}

}  // namespace voxelpipe::cuda
