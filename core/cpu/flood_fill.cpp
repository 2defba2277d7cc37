// Flood fill: the conservative shell, and the voxels that a flood from outside the grid does not reach without entering
// it (base/enclosed.cpp).
#include "cpu/flood_fill.h"

#include <algorithm>
#include <utility>

#include "base/parallel.h"
#include "cpu/base/enclosed.h"
#include "raster/spans.h"

namespace voxelpipe::cpu {
namespace {

bool IsWholeGrid(const RunState& state) {
  return state.slab.depth() == state.dims[2];
}

// True if the slab's coverage is the shell of the whole grid: every voxel that a triangle touches.
bool CoverageIsShell(const RunState& state) {
  if (!IsWholeGrid(state) || state.request.request.coverage != Coverage::kConservative) return false;
  // A target that discards no fragment covers all voxels of the triangles.
  return state.row_bits || std::any_of(state.targets.begin(), state.targets.end(), [](const CpuTarget& target) {
           return target.is_occupancy || !target.own_presence;
         });
}

// Draws the shell, whatever the request's coverage and shaders.
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

// Nothing where it was done.
absl::Status FindEnclosed(RunState& state) {
  if (!state.enclosed.empty()) return absl::OkStatus();
  BitGrid drawn;
  if (!CoverageIsShell(state)) {
    absl::StatusOr<BitGrid> shell = BitGrid::Create(state.grid.dims);
    if (!shell.ok()) return shell.status();
    if (absl::Status s = RasterShell(state, *shell); !s.ok()) return s;
    drawn = *std::move(shell);
  }
  absl::StatusOr<BitGrid> enclosed = Enclosed(drawn.empty() ? state.coverage : drawn, state.grid.dims, state.job);
  if (!enclosed.ok()) return enclosed.status();
  state.enclosed = *std::move(enclosed);
  return absl::OkStatus();
}

}  // namespace

absl::Status FloodInside(RunState& state, BitGrid& out, bool add) {
  if (absl::Status s = FindEnclosed(state); !s.ok()) return s;
  if (IsWholeGrid(state) && (!add || CoverageIsShell(state))) {  // it holds the shell
    out = std::exchange(state.enclosed, BitGrid());
    return absl::OkStatus();
  }
  if (!add) {
    absl::StatusOr<BitGrid> made = BitGrid::CreateUncleared(state.slab_dims);
    if (!made.ok()) return made.status();
    out = *std::move(made);
  }
  const int64_t first_row = state.dims[1] * state.slab.begin;
  absl::Status s = ParallelChunks(out.rows(), 256, state.job, [&](int64_t begin, int64_t end) {
    for (int64_t r = begin; r < end; ++r) {
      const std::span<uint32_t> inside = out.row(r);
      const std::span<const uint32_t> enclosed = std::as_const(state.enclosed).row(first_row + r);
      for (size_t w = 0; w < inside.size(); ++w) inside[w] = add ? inside[w] | enclosed[w] : enclosed[w];
    }
  });
  if (IsWholeGrid(state)) state.enclosed = BitGrid();  // no other slab needs it
  return s;
}

}  // namespace voxelpipe::cpu
