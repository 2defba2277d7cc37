// Per tile: row spans, fragment shading, blending, store.
#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <memory>
#include <optional>
#include <span>

#include "base/parallel.h"
#include "cpu/base/stream.h"
#include "cpu/dense_fill.h"
#include "cpu/rows/tile_spans.h"
#include "cpu/run_state.h"
#include "cpu/shaded_targets.h"
#include "cpu/sparse.h"
#include "cpu/tile_buffer.h"
#include "cpu/tile_runs.h"
#include "pipeline/plan/list_memory.h"

namespace voxelpipe::cpu {
namespace {

// Counts the voxels with a fragment that each part owns (PartTable::voxels).
class OwnedVoxels {
 public:
  explicit OwnedVoxels(size_t parts) : voxels_(parts) {}

  void BeginTile() { touched_.fill(0); }
  // A fragment in each voxel of the span, of a part of this rank (PartView::rank).
  void Add(TileSpan span, uint32_t rank) {
    uint32_t& touched = touched_[size_t(span.row())];
    uint16_t* const row = &ranks_[size_t(span.row()) * 32];
    for (int x = span.first(); x <= span.last(); ++x) {
      row[x] = uint16_t((touched >> x & 1) != 0 ? std::max<uint32_t>(row[x], rank) : rank);
    }
    touched |= span.mask();
  }
  // In: the ranks of a row's insides, which FillParts has counted already; a fragment of a higher part takes the voxel.
  void CountRow(int row, const uint16_t* inside) {
    for (uint32_t left = touched_[size_t(row)]; left != 0; left &= left - 1) {
      const int x = std::countr_zero(left);
      const uint16_t rank = ranks_[size_t(row * 32 + x)];
      if (rank <= inside[x]) continue;
      ++voxels_[rank - 1];
      if (inside[x] != 0) --voxels_[inside[x] - 1];
    }
  }
  // By rank; the difference to what FillParts counted.
  const std::vector<int64_t>& voxels() const { return voxels_; }

 private:
  std::array<uint32_t, kTileRows> touched_{};
  std::array<uint16_t, size_t(kTileRows) * 32> ranks_{};  // the highest of each voxel that is touched
  std::vector<int64_t> voxels_;
};

// Scratch memory of one thread.
struct Worker {
  Worker(const Worker&) = delete;  // ShadedTargets refer to `buffers`
  Worker& operator=(const Worker&) = delete;
  explicit Worker(const RunState& state) {
    for (const CpuTarget& target : state.targets) {
      buffers.emplace_back(target);
      any_always_present = any_always_present || target.is_occupancy || !target.own_presence;
    }
    for (const Wanted wanted : {Wanted::kAll, Wanted::kFirst, Wanted::kLast}) {
      auto targets = std::make_unique<ShadedTargets>(state, wanted, buffers);
      if (targets->empty()) continue;
      (wanted == Wanted::kLast ? backward : forward).push_back(std::move(targets));
    }
    if (state.by_parts) owned.emplace(state.part_count());
  }

  std::vector<TileBuffer> buffers;
  // By the order in which they want a tile's triangles.
  std::vector<std::unique_ptr<ShadedTargets>> forward, backward;
  TileSpans spans;
  std::array<uint32_t, kTileRows> coverage{};
  bool any_always_present = false;  // a target discards no fragment, so every touched voxel is covered
  uint64_t fragments = 0;
  std::optional<OwnedVoxels> owned;  // where parts are filled
};

// Counts the fragments of a triangle of the tile.
void CountFragments(const RunState& state, Worker& worker, uint32_t triangle, std::span<const TileSpan> spans) {
  const uint32_t covers = worker.any_always_present ? ~0u : 0;
  for (const TileSpan span : spans) {
    worker.fragments += uint64_t(span.last() - span.first() + 1);
    worker.coverage[size_t(span.row())] |= span.mask() & covers;
  }
  if (worker.owned) {
    const uint32_t rank = state.view.parts[PartOf(state.view, triangle)].rank;
    for (const TileSpan span : spans) worker.owned->Add(span, rank);
  }
}

// Counts what parts own. Takes out the fragments of targets that hold the owner's alone where the part that owns the
// voxel has none; what a target discards is no fragment of it.
void SettleOwners(const RunState& state, Worker& worker, const VoxelRange& range) {
  for (int64_t z = range.begin[2]; z < range.end[2]; ++z) {
    for (int64_t y = range.begin[1]; y < range.end[1]; ++y) {
      const auto row = int((y - range.begin[1]) + 8 * (z - range.begin[2]));
      const uint16_t* const inside = state.inside_ranks.data() + state.SlabRow(y, z) * state.dims[0] + range.begin[0];
      worker.owned->CountRow(row, inside);
      for (size_t t = 0; t < state.targets.size(); ++t) {
        if (state.targets[t].of_owner)
          worker.buffers[t].DropBelow(row, {inside, size_t(range.end[0] - range.begin[0])});
      }
    }
  }
}

// FineRaster discards the tile if the job has ended.
void RasterTile(RunState& state, Worker& worker, const TileRun& run, const VoxelRange& range) {
  const int64_t origin[3] = {range.begin[0], range.begin[1], range.begin[2]};
  worker.coverage.fill(0);
  for (TileBuffer& buffer : worker.buffers) buffer.Begin();
  if (worker.owned) worker.owned->BeginTile();
  bool counted = false;
  const auto pass = [&](TileOrder order, std::span<const std::unique_ptr<ShadedTargets>> all) {
    for (const auto& targets : all) targets->BeginTile(origin);
    ForEachTriangle(state, run, range, order, worker.spans, [&](uint32_t triangle, std::span<const TileSpan> spans) {
      if (!counted) CountFragments(state, worker, triangle, spans);
      for (const auto& targets : all) targets->Add(triangle, spans);
      return true;
    });
    for (const auto& targets : all) targets->Flush();
    counted = true;
  };
  if (!worker.backward.empty()) pass(TileOrder::kBackward, worker.backward);
  if (!worker.forward.empty() || !counted) pass(TileOrder::kForward, worker.forward);
  if (!worker.any_always_present) {
    for (size_t row = 0; row < worker.coverage.size(); ++row) {
      for (const TileBuffer& buffer : worker.buffers) worker.coverage[row] |= buffer.presence(int(row));
    }
  }
  if (worker.owned) SettleOwners(state, worker, range);
  const int64_t word = range.begin[0] / 32;
  for (int64_t z = range.begin[2]; z < range.end[2]; ++z) {
    for (int64_t y = range.begin[1]; y < range.end[1]; ++y) {
      state.coverage.row(state.SlabRow(y, z))[word] = worker.coverage[(y - origin[1]) + 8 * (z - origin[2])];
    }
  }
}

// Stores a rasterized tile: to the dense targets, or to the tile values from which bricks are made. `number` is the
// index of its run in the slab.
void StoreTile(RunState& state, const Worker& worker, uint64_t tile, const VoxelRange& range, size_t number,
               ListCount& kept) {
  const bool sparse = state.request.request.result == ResultKind::kSparse;
  for (size_t t = 0; t < state.targets.size(); ++t) {
    if (state.targets[t].is_occupancy) continue;
    if (sparse) {
      worker.buffers[t].StoreBitGrids(state, range, state.targets[t]);
    } else {
      worker.buffers[t].Store(state, range, state.targets[t]);
    }
  }
  if (!sparse) return;
  if (!kept.Add(KeptTileBytes(state, worker.coverage))) return;
  state.tile_values[number] = KeepTile(state, worker.buffers, worker.coverage, state.value_arenas.local());
  state.slab_tiles[tile - state.tiles.Index(0, 0, state.slab.begin / TileDim(2))] = uint32_t(number);
}

// One thread works on a row of tiles, those of the slab with the same y and z. It clears the voxels between them, so
// that every cache line of the targets is written once.
class TileRows {
 public:
  TileRows(RunState& state, ListCount& kept) : state_(state), kept_(kept), runs_(SlabRuns(state)) {
    layers_ = (state.slab.end + TileDim(2) - 1) / TileDim(2) - state.slab.begin / TileDim(2);
    first_run_.resize(size_t(count()) + 1);
    size_t run = 0;
    for (int64_t row = 0; row < count(); ++row) {
      first_run_[size_t(row)] = run;
      const uint64_t next = FirstTile(row + 1);
      while (run < runs_.size() && Tile(run) < next) ++run;
    }
    first_run_.back() = run;
  }

  int64_t count() const { return state_.tiles.dims[1] * layers_; }
  int64_t tiles() const { return state_.tiles.dims[0] * count(); }
  size_t runs() const { return runs_.size(); }

  void Raster(int64_t row, Worker& worker) {
    VoxelRange all = TileVoxels(state_.tiles, FirstTile(row), state_.dims);
    all.end[0] = state_.dims[0];
    ClearBits(all);
    int64_t x = 0;  // voxels before it are written
    for (size_t i = first_run_[size_t(row)]; i < first_run_[size_t(row) + 1]; ++i) {
      const VoxelRange range = TileVoxels(state_.tiles, Tile(i), state_.dims);
      ClearValues(all, x, range.begin[0]);
      RasterTile(state_, worker, runs_[i], range);
      StoreTile(state_, worker, Tile(i), range, i, kept_);
      x = range.end[0];
    }
    ClearValues(all, x, state_.dims[0]);
    StreamFence();
  }

 private:
  uint64_t Tile(size_t run) const { return state_.pairs[runs_[run].begin] >> 32; }
  uint64_t FirstTile(int64_t row) const { return state_.tiles.Index(0, row, state_.slab.begin / TileDim(2)); }

  void ClearBits(const VoxelRange& rows) {
    const auto clear = [&](BitGrid& grid) {
      if (grid.empty()) return;
      const size_t bytes = size_t((rows.end[1] - rows.begin[1]) * grid.words_per_row()) * sizeof(uint32_t);
      for (int64_t z = rows.begin[2]; z < rows.end[2]; ++z) {
        std::memset(grid.row(state_.SlabRow(rows.begin[1], z)).data(), 0, bytes);
      }
    };
    clear(state_.coverage);
    for (CpuTarget& target : state_.targets) {
      clear(target.bits);
      clear(target.presence);
    }
  }

  void ClearValues(const VoxelRange& rows, int64_t x_begin, int64_t x_end) {
    if (x_begin >= x_end) return;
    for (CpuTarget& target : state_.targets) {
      if (target.dense.size() > 0) ClearRows(state_, target, rows, x_begin, x_end);
    }
  }

  RunState& state_;
  ListCount& kept_;  // sparse
  const std::span<const TileRun> runs_;
  int64_t layers_;
  std::vector<size_t> first_run_;  // of each row of tiles
};

// Occupancy bits alone. Where parts are filled, counts what they own.
absl::Status RasterRows(RunState& state) {
  const Slab& slab = state.slab;
  if (!state.needs_ranks) return state.row_bits->Raster(slab.begin, slab.end, state.coverage, state.job);
  std::vector<int64_t> voxels(state.part_count());
  const absl::Status s =
      state.row_bits->RasterParts(slab.begin, slab.end, state.coverage, state.inside_ranks.data(), voxels, state.job);
  for (size_t rank = 0; rank < voxels.size(); ++rank) state.counts.part_voxels[rank] += uint64_t(voxels[rank]);
  return s;
}

}  // namespace

absl::Status FineRaster(RunState& state) {
  if (state.row_bits) return RasterRows(state);
  const bool sparse = state.request.request.result == ResultKind::kSparse;
  ListCount kept(sparse ? state.lists : nullptr, sparse ? SlabRuns(state).size() * sizeof(TileValues) : 0);
  TileRows rows(state, kept);
  if (sparse) {
    state.tile_values.resize(rows.runs());
    state.slab_tiles.assign(size_t(rows.tiles()), UINT32_MAX);
  }
  tbb::enumerable_thread_specific<Worker> workers([&] { return Worker(state); });
  absl::Status s = ParallelChunks(rows.count(), 1, state.job, [&](int64_t begin, int64_t end) {
    Worker& worker = workers.local();
    for (int64_t row = begin; row < end && !kept.stopped(); ++row) rows.Raster(row, worker);
  });
  state.kept_bytes = kept.bytes();
  if (absl::Status full = kept.status(); !full.ok()) return full;
  uint64_t fragments = 0;
  for (const Worker& worker : workers) {
    fragments += worker.fragments;
    for (size_t rank = 0; rank < state.part_count(); ++rank) {
      state.counts.part_voxels[rank] += uint64_t(worker.owned->voxels()[rank]);
    }
  }
  state.counts.fragments = fragments;
  return s.ok() ? state.job.Check() : s;
}

}  // namespace voxelpipe::cpu
