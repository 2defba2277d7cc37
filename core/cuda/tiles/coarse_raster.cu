// Vertices to index space; binning of triangles to tiles.
//
// Pairs (tile, triangle) are appended in no order: every blend is independent of the order of fragments. A triangle in
// at most four tiles is one thread's, any other one a block's. Pairs that find no room are counted all the same, and
// the binning is run again with room for all.
#include <algorithm>
#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "cpu/vertex_shade.h"
#include "cuda/primitives/list_sizes.h"
#include "cuda/primitives/voxel_code.h"
#include "cuda/run/run_state.h"
#include "cuda/traversal/mesh_locality.h"
#include "cuda/traversal/row_traversal.cuh"
#include "grid/index_space.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256, kLargeThreads = 128;
constexpr double kFarthest = 0x1p40;  // voxels

__global__ void __launch_bounds__(kThreads)
    PlaceKernel(const Vec3d* world, uint64_t count, IndexSpace space, Vec3d* placed, VertexCode* codes) {
  const uint64_t i = uint64_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= count) return;
  const Vec3d p = WorldToIndex(space, world[i]);
  placed[i] = p;
  codes[i] = EncodeVertex(p);
}

struct BinArgs {
  TileGrid tiles;
  int z_begin, z_end;   // of the tiles that are wanted, which are numbered from the first of them on:
  uint64_t first_tile;  // what is added to a tile's number in the grid, modulo 2^64
  const uint32_t* triangles;
  const Vec3d* positions;  // index space
  const VertexCode* codes;
  uint64_t triangle_count;
  uint32_t *pair_tiles, *pair_triangles;
  uint64_t capacity;
  uint32_t* queue;
  uint64_t *pairs, *queued;  // counters
};
__device__ inline void Put(const BinArgs& args, uint64_t at, uint64_t tile, uint64_t triangle) {
  if (at >= args.capacity) return;
  args.pair_tiles[at] = uint32_t(tile);
  args.pair_triangles[at] = uint32_t(triangle);
}

__global__ void __launch_bounds__(kThreads) BinSmall(const BinArgs args) {
  __shared__ unsigned long long room[2][kThreads / 32 + 1];
  const uint64_t t = uint64_t(blockIdx.x) * kThreads + threadIdx.x;
  bool few = false, many = false;
  int begin[3], end[3];  // tiles
  uint32_t count = 0;
  if (t < args.triangle_count) {
    const uint32_t* v = args.triangles + 3 * t;
    const CodedBox box = DecodeBox(args.codes[v[0]], args.codes[v[1]], args.codes[v[2]]);
    many = box.far;
    if (!box.far) {
      bool empty = false;
      count = 1;
      for (int i = 0; i < 3; ++i) {
        const int dim = int(TileDim(i));
        begin[i] = max(max(box.first[i], 0) / dim, i == 2 ? args.z_begin : 0);
        end[i] = box.last[i] < 0 ? 0 : min(box.last[i] / dim + 1, i == 2 ? args.z_end : int(args.tiles.dims[i]));
        empty = empty || begin[i] >= end[i];
        count = empty ? 0 : min(count * uint32_t(end[i] - begin[i]), 8u);
      }
      few = count > 0 && count <= 4;
      many = count > 4;
      if (many) count = 0;
    } else {
      count = 0;
    }
  }
  uint64_t at = BlockAllocate<kThreads>(args.pairs, count, room[0]);
  if (few) {
    for (int z = begin[2]; z < end[2]; ++z) {
      for (int y = begin[1]; y < end[1]; ++y) {
        for (int x = begin[0]; x < end[0]; ++x) Put(args, at++, args.first_tile + args.tiles.Index(x, y, z), t);
      }
    }
  }
  if (__syncthreads_or(many) == 0) return;
  const uint64_t slot = BlockAllocate<kThreads>(args.queued, many, room[1]);
  if (many) args.queue[slot] = uint32_t(t);
}

// A block takes a queued triangle and deals its rows of tiles to its threads.
__global__ void __launch_bounds__(kLargeThreads) BinLarge(const BinArgs args) {
  const uint64_t queued = *args.queued;
  for (uint64_t i = blockIdx.x; i < queued; i += gridDim.x) {
    const uint32_t t = args.queue[i];
    const uint32_t* v = args.triangles + 3 * uint64_t{t};
    const Vec3d &a = args.positions[v[0]], &b = args.positions[v[1]], &c = args.positions[v[2]];
    const TriangleSetup s = SetUpAmongTiles(a, b, c, BoundTiles(args.tiles, a, b, c).widening);
    VoxelRange wanted = AllTiles(args.tiles);
    wanted.begin[2] = args.z_begin;
    wanted.end[2] = args.z_end;
    const VoxelRange range = ClipToRange(s, wanted);
    const uint64_t rows =
        range.empty() ? 0 : uint64_t(range.end[1] - range.begin[1]) * uint64_t(range.end[2] - range.begin[2]);
    for (uint64_t first = 0; first < rows; first += kLargeThreads) {
      const uint64_t row = first + threadIdx.x;
      int64_t y = 0, z = 0, x_begin = 0, x_end = 0;
      if (row >= rows || !RowSpan(s, range, row, y, z, x_begin, x_end)) x_begin = x_end = 0;
      uint64_t at = WarpAllocate(args.pairs, uint32_t(x_end - x_begin));
      for (int64_t x = x_begin; x < x_end; ++x) {
        Put(args, at++, args.first_tile + args.tiles.Index(x, y, z), t);
      }
    }
  }
}

bool InReach(const Vec3d& p) {
  return Abs(p.x) <= kFarthest && Abs(p.y) <= kFarthest && Abs(p.z) <= kFarthest;
}

// The box of the mesh is monotone in index space, so its corners say whether any vertex is out of reach. Which one is
// looked for on the host: it ends the run.
absl::Status CheckReach(RunState& state, const GridSpec& grid) {
  const IndexSpace space = grid.index_space();
  const auto place = [&](const Vec3d& p) { return WorldToIndex(space, p); };
  if (state.host.view.triangle_count == 0 || (InReach(place(state.box.min)) && InReach(place(state.box.max)))) {
    return absl::OkStatus();
  }
  if (state.shaded_there) VOXELPIPE_OK_OR_RETURN(cpu::ShadeVertices(state.host));
  uint32_t bad = UINT32_MAX;
  const MeshView& mesh = state.host.view;
  for (uint64_t t = 0; t < mesh.triangle_count; ++t) {
    for (const uint32_t v : mesh.triangles[t]) {
      if (!InReach(place(mesh.positions[v]))) {
        bad = std::min(bad, v);
        break;  // as the CPU backend: the first corner that is out of reach stands for its triangle
      }
    }
  }
  return absl::InvalidArgumentError(
      absl::StrCat(cpu::DescribeVertex(state.host.mesh, bad), ": farther than 2^40 voxels from the grid's origin"));
}

// Whether some kernel asks for vertices in index space.
bool NeedsPlaces(const RunState& state) {
  if (state.request.request.result == ResultKind::kBuckets) {
    const PathInputs& in = state.path_inputs;
    return !RecordsReach(in.dims, in.triangles, in.record_bits) || ShadesFragments(state.request);
  }
  if (!state.plan.blends()) return true;
  for (int i = 0; i < state.targets.count; ++i) {
    const ValueSource source = state.plan.targets[size_t(i)].source;
    const bool shades_fragments = source == ValueSource::kOwners || source == ValueSource::kFragments;
    if (shades_fragments && TraitsOf(state.targets.at[i].shader).needs_plane) return true;
  }
  return false;
}

absl::Status Bin(RunState& state, uint64_t capacity) {
  VOXELPIPE_OK_OR_RETURN(state.pairs.MakeRoom(capacity, state.stream));
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kPairs, kQueued0}));
  BinArgs args;
  args.tiles = state.view.tiles;
  args.z_begin = int(state.tile_layers.begin);
  args.z_end = int(state.tile_layers.end);
  args.first_tile = -FirstTile(state);
  args.triangles = state.mesh.triangle_list();
  args.positions = state.mesh.index_positions.data();
  args.codes = state.mesh.codes.data();
  args.triangle_count = state.mesh.host_view.triangle_count;
  args.pair_tiles = state.pairs.tiles[0].data();
  args.pair_triangles = state.pairs.triangles[0].data();
  args.capacity = capacity;
  args.queue = state.queue[0].data();
  args.pairs = state.counters.data() + kPairs;
  args.queued = state.counters.data() + kQueued0;
  const uint64_t count = args.triangle_count;
  BinSmall<<<unsigned((count + kThreads - 1) / kThreads), kThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("BinSmall");
  const uint64_t blocks = std::min<uint64_t>(uint64_t(state.device.multiprocessors) * 8, count);
  BinLarge<<<unsigned(blocks), kLargeThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("BinLarge");
  auto counters = ReadCounters(state);
  if (!counters.ok()) return counters.status();
  state.pairs.count = (*counters)[kPairs];
  return absl::OkStatus();
}

}  // namespace

absl::Status PlaceVertices(RunState& state) {
  const uint64_t vertices = state.mesh.host_view.vertex_count;
  if (!state.placed && vertices > 0) {
    VOXELPIPE_OK_OR_RETURN(state.mesh.index_positions.Resize(vertices, state.stream));
    VOXELPIPE_OK_OR_RETURN(state.mesh.codes.Resize(vertices, state.stream));
    PlaceKernel<<<unsigned((vertices + kThreads - 1) / kThreads), kThreads, 0, state.stream>>>(
        state.mesh.host_view.positions, vertices, state.grid.index_space(), state.mesh.index_positions.data(),
        state.mesh.codes.data());
    VOXELPIPE_LAUNCHED_OR_RETURN("PlaceKernel");
  }
  state.placed = true;
  return absl::OkStatus();
}

namespace {

// As if memory were short: thinner slabs may do, or another backend.
absl::Status TooMuch(const std::string& what) {
  return MarkDeviceFailure(absl::ResourceExhaustedError(what), DeviceFailureKind::kOutOfMemory);
}

// The grid, and the mesh in it.
absl::Status SetUpGrid(RunState& state, const GridSpec& grid) {
  state.grid = grid;
  for (int a = 0; a < 3; ++a) state.view.dims[a] = grid.dims[size_t(a)];
  state.view.tiles = TilesOf(state.view.dims);
  state.view.words_per_row = (state.view.dims[0] + 31) / 32;
  state.view.space = grid.index_space();
  if (state.view.tiles.count() > UINT32_MAX) {
    return TooMuch("the grid has more than 2^32 tiles of 32x8x8 voxels");
  }
  // Rows and fragments of one triangle are counted in 32 bits. Along its normal's largest component a plane meets at
  // most five voxels of a column, so the largest face of the grid bounds both.
  const auto nx = double(grid.dims[0]), ny = double(grid.dims[1]), nz = double(grid.dims[2]);
  if (5 * Max(nx * ny, Max(ny * nz, nz * nx)) > double(UINT32_MAX)) {
    return TooMuch("a face of the grid has more voxels than the CUDA backend counts for one triangle");
  }
  VOXELPIPE_OK_OR_RETURN(CheckReach(state, grid));
  state.placed = false;
  state.path_inputs = PathInputsOf(state, grid);
  state.plan = PlanPath(state.path_inputs);
  const Path path = state.plan.path;
  if (path == Path::kFragmentList || state.plan.blends()) PrepareScattered(state);
  if (path == Path::kOccupancy) return absl::OkStatus();  // rows come from world space
  for (SpanTarget& target : state.span_targets) target.shaded = false;
  if (NeedsPlaces(state)) VOXELPIPE_OK_OR_RETURN(PlaceVertices(state));
  if (state.mesh.view.empty() || state.mesh.host_view.index_positions != state.mesh.index_positions.data()) {
    state.mesh.host_view.index_positions = state.mesh.index_positions.data();
    VOXELPIPE_OK_OR_RETURN(state.mesh.view.Upload({&state.mesh.host_view, 1}, state.stream));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status CoarseRaster(RunState& state, const GridSpec& grid, const Slab& layers) {
  if (layers.begin == 0) VOXELPIPE_OK_OR_RETURN(SetUpGrid(state, grid));
  const uint64_t triangles = state.mesh.host_view.triangle_count;
  state.tile_layers = {layers.begin / TileDim(2), (layers.end + TileDim(2) - 1) / TileDim(2)};
  state.pairs.count = 0;
  if (triangles == 0 || !state.plan.sorts_tiles()) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(state.queue[0].Resize(triangles, state.stream));
  const double share = double(layers.depth()) / double(grid.dims[2]);
  const uint64_t guess = std::max(state.pairs.tiles[0].size(), PairRoom(triangles, share));
  VOXELPIPE_OK_OR_RETURN(Bin(state, guess));
  if (state.pairs.count > kMaxPairs) {
    return TooMuch(absl::StrCat("triangles meet tiles of ", layers.depth(), " layers ", state.pairs.count,
                                " times; the CUDA backend takes fewer than 2^32"));
  }
  return state.pairs.count > guess ? Bin(state, state.pairs.count) : absl::OkStatus();
}

}  // namespace voxelpipe::cuda
