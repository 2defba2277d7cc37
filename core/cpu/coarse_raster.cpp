// Binning of triangles to tiles: count, scan, emit.
#include <algorithm>
#include <atomic>

#include "absl/strings/str_cat.h"
#include "cpu/parallel.h"
#include "cpu/run_state.h"

namespace voxelpipe::cpu {
namespace {

constexpr int64_t kVertexGrain = 1 << 14;
constexpr int64_t kTrianglesPerChunk = 1 << 12;
constexpr double kFarthest = 0x1p40;  // voxels

absl::Status PlaceVertices(RunState& state) {
  const MeshView& view = state.view;
  state.placed_positions = HostArray<Vec3d>(view.vertex_count);
  state.index_positions = state.placed_positions.data();
  state.view.index_positions = state.index_positions;
  return ParallelChunks(int64_t(view.vertex_count), kVertexGrain, state.job, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      state.placed_positions[uint64_t(i)] = WorldToIndex(state.grid.origin, state.grid.voxel_size, view.positions[i]);
    }
  });
}

bool InReach(const Vec3d& p) {
  return Abs(p.x) <= kFarthest && Abs(p.y) <= kFarthest && Abs(p.z) <= kFarthest;
}

}  // namespace

absl::Status CoarseRaster(RunState& state, const GridSpec& grid) {
  state.grid = grid;
  for (int a = 0; a < 3; ++a) state.dims[a] = grid.dims[size_t(a)];
  state.tiles = TilesOf(state.dims);
  if (state.tiles.count() > UINT32_MAX) {
    return absl::ResourceExhaustedError("the grid has more than 2^32 tiles of 32x8x8 voxels");
  }
  const bool fit = std::max({grid.dims[0], grid.dims[1], grid.dims[2]}) <= kMaxLaneDim;
  state.tile_kernels = fit ? state.kernels : *SelectRowKernels(SimdChoice::kScalar);
  if (PlainBits(state, grid)) {
    state.row_bits = std::make_unique<RowBits>(*state.kernels, state.view, grid, state.request.request.coverage);
    absl::Status s = state.row_bits->Place(state.request.request.fill == Fill::kParity, state.job);
    state.index_positions = state.row_bits->index_positions();
    if (!absl::IsOutOfRange(s)) return s;  // otherwise the tiles' way below names the vertex
  }
  if (absl::Status s = PlaceVertices(state); !s.ok()) return s;
  const int64_t triangles = int64_t(state.view.triangle_count);
  const int64_t chunks = (triangles + kTrianglesPerChunk - 1) / kTrianglesPerChunk;
  std::vector<std::vector<uint64_t>> emitted(static_cast<size_t>(chunks));
  std::atomic<uint64_t> bad{UINT64_MAX};
  absl::Status s = ParallelChunks(chunks, 1, state.job, [&](int64_t first_chunk, int64_t last_chunk) {
    for (int64_t chunk = first_chunk; chunk < last_chunk; ++chunk) {
      std::vector<uint64_t>& pairs = emitted[chunk];
      const int64_t end = std::min(triangles, (chunk + 1) * kTrianglesPerChunk);
      pairs.reserve(size_t(end - chunk * kTrianglesPerChunk) * 5 / 4);
      for (int64_t t = chunk * kTrianglesPerChunk; t < end; ++t) {
        const uint32_t* v = state.view.triangles[t];
        const Vec3d &a = state.index_positions[v[0]], &b = state.index_positions[v[1]],
                    &c = state.index_positions[v[2]];
        if (!InReach(a) || !InReach(b) || !InReach(c)) {
          const uint32_t first_bad = !InReach(a) ? v[0] : !InReach(b) ? v[1] : v[2];
          uint64_t seen = bad.load(std::memory_order_relaxed);
          while (first_bad < seen && !bad.compare_exchange_weak(seen, first_bad)) {}
          continue;
        }
        ForEachTile(state.tiles, a, b, c, [&](uint64_t tile) { pairs.push_back(tile << 32 | uint64_t(t)); });
      }
    }
  });
  if (!s.ok()) return s;
  if (bad.load() != UINT64_MAX) {
    return absl::InvalidArgumentError(
        absl::StrCat(DescribeVertex(state.mesh, bad.load()), ": farther than 2^40 voxels from the grid's origin"));
  }
  std::vector<uint64_t> offset(size_t(chunks) + 1, 0);
  for (int64_t i = 0; i < chunks; ++i) offset[i + 1] = offset[i] + emitted[i].size();
  state.pairs.resize(offset[chunks]);
  return ParallelChunks(chunks, 1, state.job, [&](int64_t first, int64_t last) {
    for (int64_t i = first; i < last; ++i) {
      std::copy(emitted[i].begin(), emitted[i].end(), state.pairs.begin() + int64_t(offset[i]));
      std::vector<uint64_t>().swap(emitted[i]);
    }
  });
}

}  // namespace voxelpipe::cpu
