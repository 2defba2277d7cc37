// The tiles of a slab, and masks of their rows.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "cpu/run_state.h"

namespace voxelpipe::cpu {

// The runs of the slab's tiles: tiles are numbered by layer.
inline std::span<const TileRun> SlabRuns(const RunState& state) {
  const auto first_at = [&](int64_t z) {
    const uint64_t tile = state.tiles.Index(0, 0, (z + TileDim(2) - 1) / TileDim(2));
    return std::partition_point(state.runs.begin(), state.runs.end(),
                                [&](const TileRun& run) { return state.pairs[run.begin] >> 32 < tile; });
  };
  return {first_at(state.slab.begin), first_at(state.slab.end)};
}

// Bits begin <= x < end of a tile's row, begin < end.
inline uint32_t RowMask(int64_t begin, int64_t end) {
  const uint32_t upto = end >= 32 ? ~0u : (1u << end) - 1;
  return upto & ~((1u << begin) - 1);
}

}  // namespace voxelpipe::cpu
