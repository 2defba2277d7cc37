// The tiles of a slab, and the triangles of a tile.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "cpu/rows/tile_spans.h"
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

enum class TileOrder : uint8_t { kForward, kBackward };

// Calls visit(triangle, spans) for each triangle that covers voxels of a tile (`range`: the tile cut to the grid), in
// the order of the run's pairs or its reverse, until it returns false. `scratch` holds the spans. Ends early if the job
// does: a tile may hold every triangle of the mesh.
template <typename Visit>
void ForEachTriangle(const RunState& state, const TileRun& run, const VoxelRange& range, TileOrder order,
                     TileSpans& scratch, const Visit& visit) {
  constexpr uint64_t kChunksBetweenChecks = 16;
  const RowMesh mesh = IndexSpaceMesh(state.index_positions, state.view.triangles);
  const uint64_t pairs = run.end - run.begin, chunks = (pairs + TileSpans::kTriangles - 1) / TileSpans::kTriangles;
  const bool forward = order == TileOrder::kForward;
  for (uint64_t chunk = 0; chunk < chunks; ++chunk) {
    if (chunk % kChunksBetweenChecks == 0 && !state.job.Check().ok()) return;
    const uint64_t first = (forward ? chunk : chunks - 1 - chunk) * TileSpans::kTriangles;
    const auto count = int64_t(std::min<uint64_t>(TileSpans::kTriangles, pairs - first));
    const uint64_t* const ids = &state.pairs[run.begin + first];
    state.tile_kernels->spans_in_tile(mesh, ids, count, state.request.request.coverage, range, scratch);
    for (int64_t k = 0; k < count; ++k) {
      const int64_t i = forward ? k : count - 1 - k;
      const std::span<const TileSpan> spans(scratch.spans[i], size_t(scratch.count[i]));
      if (!spans.empty() && !visit(uint32_t(ids[i]), spans)) return;
    }
  }
}

}  // namespace voxelpipe::cpu
