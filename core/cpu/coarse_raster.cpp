// Binning of triangles to tiles.
#include <algorithm>
#include <atomic>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/parallel.h"
#include "cpu/run_state.h"

namespace voxelpipe::cpu {
namespace {

constexpr int64_t kVertexGrain = 1 << 13;
constexpr int64_t kTrianglesPerChunk = 1 << 12;
constexpr int64_t kMaxChunks = 1 << 10;
constexpr int64_t kBoxesAtOnce = 1 << 9;            // boxes; they stay in the L1 cache
constexpr size_t kPairsBetweenQuestions = 1 << 16;  // of triangles that touch many tiles
constexpr int64_t kFewTiles = 4;  // so few that the box is cheaper than the test; a tile too many costs only time
constexpr double kMaxDistance = 0x1p40;  // voxels

bool InReach(const Vec3d& p) {
  return Abs(p.x) <= kMaxDistance && Abs(p.y) <= kMaxDistance && Abs(p.z) <= kMaxDistance;
}

// OUT_OF_RANGE if a triangle uses a vertex too far from the grid.
absl::Status CheckReach(const RunState& state) {
  uint64_t bad = UINT64_MAX;
  for (uint64_t t = 0; t < state.view.triangle_count; ++t) {
    for (const uint32_t v : state.view.triangles[t]) {
      if (InReach(state.index_positions[v])) continue;
      bad = std::min<uint64_t>(bad, v);
      break;
    }
  }
  if (bad == UINT64_MAX) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(DescribeVertex(state.mesh, bad), ": farther than 2^40 voxels from the grid's origin"));
}

// Transforms vertices to index space and computes their codes.
absl::Status PlaceVertices(RunState& state, HostArray<VertexCode>& codes) {
  const MeshView& view = state.view;
  state.placed_positions = HostArray<Vec3d>(view.vertex_count);
  state.index_positions = state.placed_positions.data();
  state.view.index_positions = state.index_positions;
  std::copy_n(state.grid.dims.data(), 3, state.view.grid_dims);
  codes = HostArray<VertexCode>(view.vertex_count);
  const IndexSpace space = state.grid.index_space();
  std::atomic<bool> near{true};
  absl::Status s = ParallelChunks(int64_t(view.vertex_count), kVertexGrain, state.job, [&](int64_t begin, int64_t end) {
    const Placed placed =
        state.kernels->place(view.positions, begin, end, space, state.placed_positions.data(), codes.data());
    if (!placed.near) near.store(false, std::memory_order_relaxed);
  });
  if (!s.ok() || near) return s;
  return CheckReach(state);
}

// Appends the pairs of triangles [begin, end), until their memory is refused.
void EmitPairs(const RunState& state, const VertexCode* codes, int64_t begin, int64_t end, PairBlocks& pairs,
               ListCount& count) {
  TileBox boxes[kBoxesAtOnce];
  size_t counted = 0;
  const auto granted = [&] {
    const size_t more = pairs.size() - std::exchange(counted, pairs.size());
    return count.Add(more * sizeof(uint64_t));
  };
  for (int64_t first = begin; first < end; first += kBoxesAtOnce) {
    const int64_t last = std::min(end, first + kBoxesAtOnce);
    if (codes != nullptr) state.kernels->tile_boxes(state.view.triangles, codes, first, last, state.dims, boxes);
    for (int64_t t = first; t < last; ++t) {
      if (codes != nullptr) {
        const TileBox& box = boxes[t - first];
        if (box.kind == TileBox::kOutside) continue;
        if (box.kind == TileBox::kBoxed && box.tiles() <= kFewTiles) {
          for (int64_t z = box.first[2]; z <= box.last[2]; ++z) {
            for (int64_t y = box.first[1]; y <= box.last[1]; ++y) {
              for (int64_t x = box.first[0]; x <= box.last[0]; ++x) {
                pairs.push_back(state.tiles.Index(x, y, z) << 32 | uint64_t(t));
              }
            }
          }
          continue;
        }
      }
      const uint32_t* v = state.view.triangles[t];
      ForEachTile(state.tiles, state.index_positions[v[0]], state.index_positions[v[1]], state.index_positions[v[2]],
                  [&](uint64_t tile) { pairs.push_back(tile << 32 | uint64_t(t)); });
      if (pairs.size() - counted > kPairsBetweenQuestions && !granted()) return;
    }
    if (!granted()) return;
  }
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
  const bool addressed = state.view.vertex_count <= kMaxLaneVertices;
  state.shade_kernels = &ShadeKernelsNamed(addressed ? state.kernels->name : "scalar");
  if (PlainBits(state, grid)) {
    state.row_bits = std::make_unique<RowBits>(*state.kernels, state.view, grid, state.request.request.coverage);
    absl::Status s = state.row_bits->Place(CastsLines(state.request.request.fill), state.job);
    state.index_positions = state.row_bits->index_positions();
    if (!absl::IsOutOfRange(s)) return s;  // the tile path below names the vertex
  }
  HostArray<VertexCode> codes;
  if (absl::Status s = PlaceVertices(state, codes); !s.ok()) return s;
  if (state.request.request.coverage == Coverage::kNone) return absl::OkStatus();
  const VertexCode* const fitting = RowBitsFit(grid, state.view.triangle_count) ? codes.data() : nullptr;
  const auto triangles = int64_t(state.view.triangle_count);
  const int64_t per_chunk = std::max(kTrianglesPerChunk, triangles / kMaxChunks);
  const int64_t chunks = (triangles + per_chunk - 1) / per_chunk;
  state.emitted.resize(size_t(chunks));
  ListCount count(state.lists, 0);
  absl::Status s = ParallelChunks(chunks, 1, state.job, [&](int64_t first, int64_t last) {
    for (int64_t chunk = first; chunk < last; ++chunk) {
      const int64_t begin = chunk * per_chunk, end = std::min(triangles, begin + per_chunk);
      PairBlocks& pairs = state.emitted[size_t(chunk)];
      pairs.reserve(size_t(end - begin) * 9 / 8);
      EmitPairs(state, fitting, begin, end, pairs, count);
    }
  });
  return count.stopped() ? count.status() : s;
}

}  // namespace voxelpipe::cpu
