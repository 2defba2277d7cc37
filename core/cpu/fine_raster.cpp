// Per tile: row spans, fragment shading, blending, store.
#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <bit>
#include <span>

#include "cpu/parallel.h"
#include "cpu/run_state.h"
#include "cpu/sparse.h"
#include "cpu/tile_buffer.h"
#include "cpu/tile_runs.h"
#include "shaders/fragment_input.h"

namespace voxelpipe::cpu {
namespace {

// What one thread works in.
struct Worker {
  explicit Worker(const RunState& state) {
    for (const CpuTarget& target : state.targets) {
      buffers.emplace_back(target);
      if (target.is_occupancy) continue;
      traits |= TraitsOf(target.shader);
      shades = true;
      any_always_present = any_always_present || !target.own_presence;
    }
    any_always_present = any_always_present || std::any_of(state.targets.begin(), state.targets.end(),
                                                           [](const CpuTarget& t) { return t.is_occupancy; });
  }

  std::vector<TileBuffer> buffers;
  std::array<uint32_t, kTileRows> coverage{};
  bool shades = false;              // some target needs its fragments shaded one by one
  ShaderTraits traits;              // what those shaders ask for, together
  bool any_always_present = false;  // some target keeps every fragment, so a touched voxel is a covered one
  uint64_t fragments = 0;
};

void ShadeRow(const RunState& state, Worker& worker, const TrianglePlane& plane, FragmentInput& in, int row,
              uint32_t mask, const int64_t (&origin)[3]) {
  uint32_t covered = worker.any_always_present ? mask : 0;
  for (uint32_t left = mask; left != 0; left &= left - 1) {
    const int bit = std::countr_zero(left);
    in.voxel[0] = origin[0] + bit;
    in.voxel[1] = origin[1] + row % 8;
    in.voxel[2] = origin[2] + row / 8;
    if (worker.traits.needs_barycentrics) in.barycentric = Barycentrics(plane, in.voxel[0], in.voxel[1], in.voxel[2]);
    for (size_t t = 0; t < state.targets.size(); ++t) {
      const CpuTarget& target = state.targets[t];
      if (target.is_occupancy) continue;
      FragmentOutput out;
      ShadeFragment(target.shader, in, target.params, out);
      if (out.discard) continue;
      worker.buffers[t].Blend(row, bit, out);
      covered |= 1u << bit;
    }
  }
  worker.coverage[row] |= covered;
}

void RasterTile(RunState& state, Worker& worker, const TileRun& run) {
  const uint64_t tile = state.pairs[run.begin] >> 32;
  const VoxelRange range = TileVoxels(state.tiles, tile, state.dims);
  const int64_t origin[3] = {range.begin[0], range.begin[1], range.begin[2]};
  worker.coverage.fill(0);
  for (TileBuffer& buffer : worker.buffers) buffer.Begin();
  for (uint64_t i = run.begin; i < run.end; ++i) {
    const uint32_t triangle = uint32_t(state.pairs[i]);
    const uint32_t* v = state.view.triangles[triangle];
    const TriangleSetup setup = SetUpTriangle(state.index_positions[v[0]], state.index_positions[v[1]],
                                              state.index_positions[v[2]], state.request.request.coverage);
    FragmentInput in;
    TrianglePlane plane;
    ForEachRowSpan(setup, range, [&](int64_t y, int64_t z, int64_t x_begin, int64_t x_end) {
      const int row = int((y - origin[1]) + 8 * (z - origin[2]));
      const uint32_t mask = RowMask(x_begin - origin[0], x_end - origin[0]);
      worker.fragments += uint64_t(x_end - x_begin);
      if (!worker.shades) {
        worker.coverage[row] |= mask;
        return;
      }
      if (in.mesh == nullptr) {
        plane = SetUpPlane(state.index_positions[v[0]], state.index_positions[v[1]], state.index_positions[v[2]]);
        in = MakeFragmentInput(state.view, triangle, plane.degenerate, worker.traits.reads_textures());
      }
      ShadeRow(state, worker, plane, in, row, mask, origin);
    });
  }
  const int64_t word = range.begin[0] / 32;
  for (int64_t z = range.begin[2]; z < range.end[2]; ++z) {
    for (int64_t y = range.begin[1]; y < range.end[1]; ++y) {
      state.coverage.row(state.SlabRow(y, z))[word] = worker.coverage[(y - origin[1]) + 8 * (z - origin[2])];
    }
  }
}

// Hands a rasterized tile on: to the dense targets, or to the values that bricks are made of. `number` counts the slab's runs.
void StoreTile(RunState& state, const Worker& worker, const TileRun& run, size_t number) {
  const uint64_t tile = state.pairs[run.begin] >> 32;
  const VoxelRange range = TileVoxels(state.tiles, tile, state.dims);
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
  state.tile_values[number] = KeepTile(state, worker.buffers, worker.coverage, state.value_arenas.local());
  state.slab_tiles[tile - state.tiles.Index(0, 0, state.slab.begin / TileDim(2))] = uint32_t(number);
}

}  // namespace

absl::Status FineRaster(RunState& state) {
  if (state.row_bits) return state.row_bits->Raster(state.slab.begin, state.slab.end, state.coverage, state.job);
  const std::span<const TileRun> runs = SlabRuns(state);
  if (state.request.request.result == ResultKind::kSparse) {
    state.tile_values.resize(runs.size());
    const int64_t layers = (state.slab.end + TileDim(2) - 1) / TileDim(2) - state.slab.begin / TileDim(2);
    state.slab_tiles.assign(size_t(state.tiles.dims[0] * state.tiles.dims[1] * layers), UINT32_MAX);
  }
  tbb::enumerable_thread_specific<Worker> workers([&] { return Worker(state); });
  absl::Status s = ParallelChunks(int64_t(runs.size()), 1, state.job, [&](int64_t begin, int64_t end) {
    Worker& worker = workers.local();
    for (int64_t i = begin; i < end; ++i) {
      RasterTile(state, worker, runs[size_t(i)]);
      StoreTile(state, worker, runs[size_t(i)], size_t(i));
    }
  });
  uint64_t fragments = 0;
  for (const Worker& worker : workers) fragments += worker.fragments;
  state.counts.fragments = fragments;
  return s;
}

}  // namespace voxelpipe::cpu
