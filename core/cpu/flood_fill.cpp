// Flood fill: the voxels that a 6-connected flood from outside the grid cannot reach without entering the conservative
// shell.
//
// Source: the scan-line seed fill (A. R. Smith, "Tangent Fill", 1979) on words of 32 voxels. Changed: a row takes all
// its seeds at once, and rows are visited in alternating sweeps until none has changed.
#include "cpu/flood_fill.h"

#include <algorithm>
#include <bit>
#include <vector>

#include "base/parallel.h"
#include "grid/word_spread.h"
#include "raster/spans.h"

namespace voxelpipe::cpu {
namespace {

// Every voxel that a triangle touches, whatever the request's coverage and shaders.
absl::Status RasterShell(const RunState& state, BitGrid& shell) {
  if (RowBitsFit(state.grid, state.view.triangle_count)) {
    if (state.row_bits && state.request.request.coverage == Coverage::kConservative) {
      return state.row_bits->Raster(0, state.dims[2], shell, state.job);
    }
    RowBits rows(*state.kernels, state.view, state.grid, Coverage::kConservative);
    if (absl::Status s = rows.Place(false, state.job); !s.ok()) return s;
    return rows.Raster(0, state.dims[2], shell, state.job);
  }
  return ParallelChunks(int64_t(state.runs.size()), 1, state.job, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      const TileRun& run = state.runs[size_t(i)];
      const VoxelRange range = TileVoxels(state.tiles, state.pairs[run.begin] >> 32, state.dims);
      const int64_t word = range.begin[0] / 32;
      for (uint64_t pair = run.begin; pair < run.end; ++pair) {
        const uint32_t* v = state.view.triangles[uint32_t(state.pairs[pair])];
        const auto setup = SetUpTriangle(state.index_positions[v[0]], state.index_positions[v[1]],
                                         state.index_positions[v[2]], Coverage::kConservative);
        ForEachRowSpan(setup, range, [&](int64_t y, int64_t z, int64_t x_begin, int64_t x_end) {
          const int first = int(x_begin - range.begin[0]), count = int(x_end - x_begin);
          const uint32_t mask = (count >= 32 ? ~0u : (1u << count) - 1) << first;
          shell.row(y + state.dims[1] * z)[size_t(word)] |= mask;
        });
      }
    }
  });
}

// The flood. Rows are numbered y + ny*z.
class Walk {
 public:
  Walk(const std::array<int64_t, 3>& dims, const BitGrid& shell, BitGrid& reached)
      : ny_(dims[1]),
        nz_(dims[2]),
        last_bit_((dims[0] - 1) % 32),
        shell_(shell),
        reached_(reached),
        dirty_(size_t(ny_ * nz_), 1) {}

  absl::Status Run(const JobContext& job) {
    // Rows may be a million voxels long.
    const int64_t rows_between_checks = std::max<int64_t>(1, (int64_t{1} << 17) / shell_.words_per_row());
    for (bool changed = true, forward = true; changed; forward = !forward) {
      changed = false;
      for (int64_t step = 0; step < ny_ * nz_; ++step) {
        const int64_t row = forward ? step : ny_ * nz_ - 1 - step;
        if (step % rows_between_checks == 0) {
          if (absl::Status s = job.Check(); !s.ok()) return s;
        }
        if (dirty_[size_t(row)] && Visit(row)) changed = true;
      }
    }
    return absl::OkStatus();
  }

 private:
  // Takes the seeds of the four neighbouring rows; the layer around the grid counts as reached. True if the row grew.
  bool Visit(int64_t row) {
    dirty_[size_t(row)] = 0;
    const int64_t y = row % ny_, z = row / ny_;
    const std::span<const uint32_t> shell = shell_.row(row);
    const std::span<uint32_t> reached = reached_.row(row);
    const int64_t neighbour[4] = {y > 0 ? row - 1 : -1, y + 1 < ny_ ? row + 1 : -1, z > 0 ? row - ny_ : -1,
                                  z + 1 < nz_ ? row + ny_ : -1};
    const size_t words = reached.size();
    const uint32_t last_mask = shell_.last_word_mask();
    bool grew = false;
    const auto grow = [&](size_t w, uint32_t seeds) {
      const uint32_t open = ~shell[w] & (w + 1 == words ? last_mask : ~0u);
      const uint32_t now = SpreadInWord(reached[w] | seeds, open);
      grew = grew || now != reached[w];
      reached[w] = now;
    };
    for (size_t w = 0; w < words; ++w) {
      uint32_t seeds = 0;
      for (const int64_t n : neighbour) seeds |= n < 0 ? ~0u : reached_.row(n)[w];
      if (w == 0) seeds |= 1;
      if (w + 1 == words) seeds |= 1u << last_bit_;
      if (w > 0) seeds |= reached[w - 1] >> 31;
      grow(w, seeds);
    }
    for (size_t w = words - 1; w-- > 0;) {
      if (reached[w + 1] & 1) grow(w, 1u << 31);
    }
    if (!grew) return false;
    for (const int64_t n : neighbour) {
      if (n >= 0) dirty_[size_t(n)] = 1;
    }
    return true;
  }

  const int64_t ny_, nz_, last_bit_;
  const BitGrid& shell_;
  BitGrid& reached_;
  std::vector<uint8_t> dirty_;
};

}  // namespace

absl::Status FindOutside(RunState& state) {
  if (!state.outside.empty()) return absl::OkStatus();
  absl::StatusOr<BitGrid> shell = BitGrid::Create(state.grid.dims);
  if (!shell.ok()) return shell.status();
  if (absl::Status s = RasterShell(state, *shell); !s.ok()) return s;
  absl::StatusOr<BitGrid> outside = BitGrid::Create(state.grid.dims);
  if (!outside.ok()) return outside.status();
  if (absl::Status s = Walk(state.grid.dims, *shell, *outside).Run(state.job); !s.ok()) return s;
  state.outside = *std::move(outside);
  return absl::OkStatus();
}

absl::Status FloodInside(RunState& state, BitGrid& out, bool add) {
  if (absl::Status s = FindOutside(state); !s.ok()) return s;
  const uint32_t last_mask = out.last_word_mask();
  const int64_t first_row = state.dims[1] * state.slab.begin;
  return ParallelChunks(out.rows(), 256, state.job, [&](int64_t begin, int64_t end) {
    for (int64_t r = begin; r < end; ++r) {
      const std::span<uint32_t> inside = out.row(r);
      const std::span<const uint32_t> outside = std::as_const(state.outside).row(first_row + r);
      for (size_t w = 0; w < inside.size(); ++w) inside[w] = add ? inside[w] | ~outside[w] : ~outside[w];
      inside.back() &= last_mask;
    }
  });
}

}  // namespace voxelpipe::cpu
