// How many voxels, bricks and tiles a surface touches follows from the Minkowski sum of a triangle T and a box B of edges e:
// averaged over all placements of a lattice of such boxes, T touches vol(T + B) / vol(B) of them, which is 1, plus its three
// widths over e, plus its three projected areas over the products of the other two edges. (R. Schneider and W. Weil,
// "Stochastic and Integral Geometry", 2008, section 5.1.) Constants were measured.
#include "pipeline/footprint.h"

#include <algorithm>
#include <cmath>
#include <thread>

#include "grid/bit_grid.h"
#include "pipeline/result.h"
#include "raster/tiles.h"
#include "shaders/catalog.h"

namespace voxelpipe {
namespace {

// Fixed costs of the run besides grids: arenas, tile buffers of each thread.
constexpr uint64_t kBaseBytes = 4 << 20;
constexpr double kTileListBytes = 280;       // sparse: what is kept of a tile besides its values
constexpr double kTileFragmentBytes = 1350;  // buckets: the rows of a tile
constexpr double kRecordBytes = 8;           // buckets: a run of voxels in a row takes 12, and holds about 1.5
constexpr double kBrickBytes = 72;           // id and mask

bool IsOccupancyBit(const TargetSpec& target) {
  return target.format == VoxelFormat::kBit && target.shader.name == "occupancy";
}

// Whether a shader can drop fragments, so that a target keeps a presence bit of its own.
bool OwnPresence(const TargetSpec& target) {
  const ShaderInfo* info = FindShader(ShaderStage::kFragment, target.shader.name);
  return info != nullptr && info->can_discard;
}

// No targets but coverage itself: rows are set without tiles.
bool PlainBits(const VoxelizeRequest& request) {
  return request.result != ResultKind::kBuckets &&
         std::all_of(request.targets.begin(), request.targets.end(), IsOccupancyBit);
}

// The surface in voxels: sums over the triangles.
struct Surface {
  Vec3d area, width;
  double thin = 1;  // share of the conservative fragments that thin coverage keeps
};

Surface InVoxels(const GridSpec& grid, const MeshSize& mesh) {
  const Vec3d& h = grid.voxel_size;
  Vec3d area = mesh.extent.projected_area, width = mesh.extent.width;
  const double n = double(mesh.triangles);
  if (area.x + area.y + area.z <= 0 && !mesh.extent.box.empty) {  // not measured: those of the box
    const Vec3d d = mesh.extent.box.max - mesh.extent.box.min;
    area = {2 * d.y * d.z, 2 * d.z * d.x, 2 * d.x * d.y};
    width = Vec3d{1, 1, 1} * std::sqrt((area.x + area.y + area.z) * std::max(1.0, n));
  }
  // No triangle covers more than the grid's own sections, however far it reaches beyond it.
  const Vec3d dims{double(grid.dims[0]), double(grid.dims[1]), double(grid.dims[2])};
  Surface out{};
  for (int a = 0; a < 3; ++a) {
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    out.area[a] = std::min(area[a] / (h[b] * h[c]), n * dims[b] * dims[c]);
    out.width[a] = std::min(width[a] / h[a], n * dims[a]);
  }
  const Vec3d& dominant = mesh.extent.dominant_area;
  const double all = area.x + area.y + area.z, main = dominant.x + dominant.y + dominant.z;
  constexpr double kRandomDirections = 0.555;  // E max|n| / E (|nx| + |ny| + |nz|) of a unit vector n
  out.thin = all > 0 && main > 0 ? main / all : kRandomDirections;
  return out;
}

// Boxes of a lattice that the surface touches: `each` counts once a triangle, `once` those of a surface whose triangles are
// larger than the boxes or hang together.
struct Touched {
  double each, once;
};
Touched Touch(const Surface& surface, double triangles, const Vec3d& edges, double all) {
  double areas = 0, widths = 0;
  for (int a = 0; a < 3; ++a) {
    areas += surface.area[a] / (edges[(a + 1) % 3] * edges[(a + 2) % 3]);
    widths += surface.width[a] / edges[a];
  }
  const double each = areas + widths + triangles;
  return {each, std::min({each, 1.12 * areas + 64, all})};
}

// What the mesh touches of the grid.
struct Counts {
  double fragments = 0, voxels = 0;  // of the request's coverage
  double tiles = 0, pairs = 0;       // of 32x8x8 voxels; (tile, triangle)
  double bricks = 0;                 // occupied
  double listed = 0;                 // voxels of a sparse result, filled ones included
};

Counts Count(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh) {
  const Surface surface = InVoxels(grid, mesh);
  const double n = double(mesh.triangles), all = double(grid.voxels());
  constexpr double kBrickVoxels = 512;
  const Touched voxels = Touch(surface, n, {1, 1, 1}, all);
  const Touched bricks = Touch(surface, n, {8, 8, 8}, all / kBrickVoxels + 1);
  const Vec3d tile{double(TileDim(0)), double(TileDim(1)), double(TileDim(2))};
  const Touched tiles = Touch(surface, n, tile, all / kTileVoxels + 1);
  const double share = request.coverage == Coverage::kConservative ? 1 : surface.thin;
  const bool covers = request.coverage != Coverage::kNone;
  Counts out;
  out.fragments = voxels.each * share;
  out.voxels = std::min(voxels.once * share, out.fragments);
  out.tiles = tiles.once;
  out.pairs = tiles.each;
  out.bricks = bricks.once;
  if (!covers) out = Counts();
  out.listed = out.voxels;
  if (request.fill != Fill::kNone) {
    const Vec3d& h = grid.voxel_size;
    const double inside = std::abs(mesh.extent.volume) / (h.x * h.y * h.z);
    out.listed = inside > 0 ? std::min(all, inside + 0.5 * out.voxels) : all;
    out.bricks = std::min(all / kBrickVoxels + 1, out.listed / kBrickVoxels + out.bricks);
  }
  return out;
}

double ValueBytes(const VoxelizeRequest& request) {
  double bytes = 0;
  for (const TargetSpec& target : request.targets) {
    bytes += double(target.components) * double(BitsPerComponent(target.format)) / 8;
  }
  return bytes;
}

uint64_t ListedBytes(const VoxelizeRequest& request, const Counts& counts) {
  if (request.result == ResultKind::kBuckets) {
    return uint64_t(16 * counts.voxels + (4 + ValueBytes(request)) * counts.fragments);
  }
  return uint64_t(kBrickBytes * counts.bricks + ValueBytes(request) * counts.listed);
}

// What is kept of all tiles until a list is made of them: of a sparse result the values, of buckets the fragments.
double KeptBytes(const VoxelizeRequest& request, const Counts& counts) {
  if (request.result == ResultKind::kBuckets) {
    return kRecordBytes * counts.fragments + kTileFragmentBytes * counts.tiles;
  }
  if (PlainBits(request)) return 0;
  double value = 0;
  for (const TargetSpec& target : request.targets) {
    if (IsOccupancyBit(target)) continue;
    value += target.format == VoxelFormat::kBit ? 1 : double(target.components * BitsPerComponent(target.format)) / 8;
  }
  return value * counts.voxels + kTileListBytes * counts.tiles;
}

// The bit grids over `layers` layers that the stages hold besides the targets: coverage, inside bits of a fill, bits and
// presence of targets that are not the coverage itself.
uint64_t BitGridBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers) {
  if (request.result == ResultKind::kBuckets) return 0;
  const bool dense = request.result == ResultKind::kDense;
  const TargetSpec& last = request.targets.back();
  const bool handed_over = dense && request.fill == Fill::kNone && IsOccupancyBit(last) && last.clear == 0 &&
                           grid.dims[0] % 32 == 0;  // rows of whole words: the coverage becomes the result
  uint64_t grids = (handed_over ? 0 : 1) + (request.fill == Fill::kNone ? 0 : 1);
  for (const TargetSpec& target : request.targets) {
    const bool in_tiles = request.result == ResultKind::kSparse;  // their bits stay with their tiles
    if (target.format == VoxelFormat::kBit && !IsOccupancyBit(target) && !in_tiles) ++grids;
    if (OwnPresence(target)) ++grids;
  }
  return grids * BitGrid::BytesFor({grid.dims[0], grid.dims[1], layers});
}

// The signed counters of a nonzero fill over `layers` layers: on a device those of as many rows as take turns
// (cuda/solid_fill.cu), on the host those of a block of rows for each thread (cpu/solid_fill.cpp).
uint64_t SumBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers, bool cuda) {
  if (request.fill != Fill::kNonzero) return 0;
  constexpr uint64_t kMostOnDevice = 256 << 20, kLeastBlock = 1 << 20, kMostThreads = 64, kBlocks = 2048;
  const uint64_t all = 32 * BitGrid::BytesFor({grid.dims[0], grid.dims[1], layers});
  const uint64_t row = 32 * BitGrid::BytesFor({grid.dims[0], 1, 1});
  if (cuda) return std::min(all, std::max(kMostOnDevice, row));
  const uint64_t threads = request.threads > 0 ? uint64_t(request.threads) : std::thread::hardware_concurrency();
  return std::min(all, std::clamp<uint64_t>(threads, 1, kMostThreads) * std::max({kLeastBlock, row, all / kBlocks}));
}

// Bytes of dense targets over `layers` layers.
uint64_t DenseBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers) {
  const uint64_t voxels = uint64_t(grid.dims[0]) * uint64_t(grid.dims[1]) * uint64_t(layers);
  uint64_t bytes = 0;
  for (const TargetSpec& target : request.targets) bytes += TargetBytes(target, voxels);
  return bytes;
}

// Vertices and triangles as the stages keep them for the whole run.
uint64_t MeshWorkBytes(const VoxelizeRequest& request, const MeshSize& mesh, const Counts& counts) {
  uint64_t shaded = mesh.extent.shaded_bytes;
  if (shaded == 0 && request.vertex_shader.name != "identity") {  // not known yet: positions and normals
    shaded = mesh.vertices * (sizeof(Vec3d) + sizeof(Vec3f));
  }
  if (PlainBits(request)) {
    constexpr uint64_t kCode = 8, kBinned = 4;  // a vertex's voxel; a triangle's id in the slabs' lists
    const uint64_t vertex = kCode + (CastsLines(request.fill) ? sizeof(Vec3d) : 0);
    return shaded + mesh.vertices * vertex + mesh.triangles * kBinned;
  }
  // Pairs are held twice while they are gathered.
  return shaded + mesh.vertices * sizeof(Vec3d) + uint64_t(2 * sizeof(uint64_t) * counts.pairs);
}

// What is left of the parts of tiles that the CUDA backend splits (cuda/fine_args.cuh), until they are joined.
uint64_t PartBytes(const VoxelizeRequest& request, const Counts& counts) {
  constexpr double kLeastPairs = 1024, kMostParts = 1024,
                   kPairsOfSplitTile = 2;  // of a part; parts; parts' pairs, more than
  constexpr uint64_t kGroup = 100 << 10;   // targets are blended in groups of so many bytes, or alone
  if (counts.pairs <= kPairsOfSplitTile * kLeastPairs) return 0;
  const double parts = counts.pairs / std::max(kLeastPairs, counts.pairs / kMostParts);
  uint64_t together = 0, largest = 0;
  for (const TargetSpec& target : request.targets) {
    const uint64_t component = target.blend == Blend::kAdd || target.blend == Blend::kAverage ? 8 : 4;
    const uint64_t of_voxel = 4 + component * uint64_t(target.components);  // an owner or a count
    together += kTileVoxels * of_voxel;
    largest = std::max(largest, kTileVoxels * of_voxel);
  }
  return uint64_t(parts * (1 + 1 / kPairsOfSplitTile)) * std::min(together, std::max(kGroup, largest));
}

// The pool of bricks from which the CUDA backend gives out those of a sparse result while triangles are drawn (cuda/brick_pool.h), of `layers` layers;
// 0 where it does not.
uint64_t PoolBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers) {
  if (request.result != ResultKind::kSparse || request.fill != Fill::kNone || request.targets.size() != 1) return 0;
  const TargetSpec& target = request.targets[0];
  const bool is_float = target.format == VoxelFormat::kF16 || target.format == VoxelFormat::kF32;
  if (!is_float || target.components != 1 || (target.blend != Blend::kMax && target.blend != Blend::kMin)) return 0;
  constexpr uint64_t kPlace = 512 * sizeof(uint32_t) + 64 + 8, kLeast = 1 << 10, kOfFaces = 4;
  const uint64_t x = uint64_t(grid.dims[0] + 7) / 8, y = uint64_t(grid.dims[1] + 7) / 8, z = uint64_t(layers + 7) / 8;
  const uint64_t bricks = x * y * z;
  return bricks * sizeof(uint32_t) + std::min(bricks, kLeast + kOfFaces * (x * y + y * z + z * x)) * kPlace;
}

// What the CUDA backend lists on the device. That is the same whether a target's value is uniform over a triangle, which is not known
// before the vertex shader ran, or not: pairs of tiles and triangles then take the place of records and spans.
uint64_t DeviceListBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                         const Counts& counts, int64_t layers) {
  constexpr uint64_t kQueues = 2 * sizeof(uint32_t), kRecord = 2 * sizeof(uint64_t), kSpan = sizeof(uint64_t);
  constexpr uint64_t kOrder = sizeof(uint32_t);
  if (PlainBits(request)) return mesh.triangles * (kQueues + kOrder);
  // A triangle that touches many voxels has a span for each of its rows, others are records; there is room for a span for every second.
  constexpr double kManyVoxels = 16, kVoxelsOfSpan = 2;
  const double n = double(mesh.triangles);
  const double rows = counts.fragments > kManyVoxels * n ? counts.fragments / kVoxelsOfSpan : 0;
  const auto spans = uint64_t(std::max(n / 2 + double(1 << 18), rows));
  uint64_t bytes = mesh.triangles * (kQueues + kRecord) + spans * kSpan;
  if (request.result == ResultKind::kBuckets) {
    constexpr uint64_t kFragment =
        2 * (sizeof(uint32_t) + sizeof(uint32_t));      // voxel and triangle, to sort from and to
    constexpr uint64_t kBucket = 2 * sizeof(uint64_t);  // room for as many as fragments
    return bytes + uint64_t(counts.fragments) * (kFragment + kBucket);
  }
  bytes += mesh.triangles * kOrder;
  bytes = std::max(bytes, mesh.triangles * kQueues + PartBytes(request, counts));  // either the one way or the other
  const bool sparse = request.result == ResultKind::kSparse;
  const double kept = sparse ? counts.listed : counts.voxels;
  if (sparse) {
    constexpr double kRowRanks = 512;  // a brick
    bytes += uint64_t(kRowRanks * counts.bricks + sizeof(uint32_t) * counts.listed);
    bytes = std::max(bytes, mesh.triangles * kQueues + PoolBytes(request, grid, layers));  // likewise
  }
  for (const TargetSpec& target : request.targets) {
    if (target.format == VoxelFormat::kBit) continue;
    const bool sums = target.blend == Blend::kAdd || target.blend == Blend::kAverage;
    const uint64_t cell = uint64_t(target.components) * (sums ? sizeof(int64_t) : sizeof(uint32_t));
    bytes += (mesh.triangles + uint64_t(kept)) * cell;  // values, and what they are blended in
  }
  return bytes;
}

// A slab deep enough for the whole grid, or a multiple of the granularity.
template <typename Bytes>
int64_t SlabDepth(const GridSpec& grid, const PlanLimits& limits, bool bounded, const Bytes& slab_bytes) {
  int64_t depth = grid.dims[2];
  if (limits.slab_depth > 0) {
    depth = std::min(depth, limits.slab_depth);
  } else if (bounded) {
    while (depth > kSlabGranularity && slab_bytes(depth) > limits.slab_bytes) depth = depth / 2;
  }
  if (depth == grid.dims[2]) return depth;
  return std::min(grid.dims[2], (depth + kSlabGranularity - 1) / kSlabGranularity * kSlabGranularity);
}

}  // namespace

Footprint PredictFootprint(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                           const PlanLimits& limits, Delivery delivery, bool cuda) {
  const bool dense = request.result == ResultKind::kDense;
  const Counts counts = Count(request, grid, mesh);
  Footprint out;
  out.result_bytes = dense ? DenseBytes(request, grid, grid.dims[2]) : ListedBytes(request, counts);
  // A slab's cost grows with its layers; of what lists are made of, a slab holds the layers' share.
  const double kept = dense ? 0 : KeptBytes(request, counts);
  const auto slab_bytes = [&](int64_t layers) {
    const double share = double(layers) / double(grid.dims[2]);
    const uint64_t made = dense ? DenseBytes(request, grid, layers) : uint64_t(share * double(out.result_bytes));
    return made + uint64_t(share * kept) + BitGridBytes(request, grid, layers);
  };
  out.slab_depth = SlabDepth(grid, limits, !dense || delivery == Delivery::kStream, slab_bytes);

  const bool one_slab = out.slab_depth >= grid.dims[2];
  Counts held = counts;
  if (cuda) held.pairs *= double(out.slab_depth) / double(grid.dims[2]);  // tiles are sorted slab by slab
  out.peak_bytes = kBaseBytes + slab_bytes(out.slab_depth) + MeshWorkBytes(request, mesh, held);
  if (cuda) out.peak_bytes += DeviceListBytes(request, grid, mesh, counts, out.slab_depth);
  if (cuda && dense && !one_slab) out.peak_bytes += slab_bytes(out.slab_depth);  // one is copied while another is made
  if (!one_slab && dense && delivery == Delivery::kMemory) out.peak_bytes += out.result_bytes;
  // The lists of all slabs, the last one's counted already, and what they are joined to.
  if (!one_slab && !dense) {
    const double earlier = 1 - double(out.slab_depth) / double(grid.dims[2]);
    out.peak_bytes += uint64_t((1 + earlier) * double(out.result_bytes));
  }
  out.peak_bytes += SumBytes(request, grid, out.slab_depth, cuda);
  if (request.fill == Fill::kFlood) {
    // The shell and what is reached from outside; one slab's inside takes the place of the shell.
    out.peak_bytes += (one_slab ? 1 : 2) * BitGrid::BytesFor(grid.dims);
  }
  return out;
}

uint64_t PredictSlabBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, int64_t layers) {
  const double share = double(layers) / double(grid.dims[2]);
  Counts counts = Count(request, grid, mesh);
  const double listed = request.result == ResultKind::kDense ? 0 : share * double(ListedBytes(request, counts));
  const double kept = request.result == ResultKind::kSparse ? share * KeptBytes(request, counts) : 0;
  for (double* count : {&counts.fragments, &counts.voxels, &counts.pairs, &counts.bricks, &counts.listed})
    *count *= share;
  uint64_t bytes = BitGridBytes(request, grid, layers) + DeviceListBytes(request, grid, mesh, counts, layers);
  if (request.result == ResultKind::kDense) bytes += DenseBytes(request, grid, layers);
  if (request.fill == Fill::kFlood) bytes += 2 * BitGrid::BytesFor(grid.dims);
  bytes += SumBytes(request, grid, layers, true);
  return bytes + uint64_t(listed + kept);
}

int64_t FittingSlabDepth(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, int64_t depth,
                         uint64_t room) {
  if (PredictSlabBytes(request, grid, mesh, depth) <= room) return depth;
  const bool dense = request.result == ResultKind::kDense;
  int64_t layers = (depth + kSlabGranularity - 1) / kSlabGranularity;  // in units of it
  const auto fits = [&] {
    const int64_t here = layers * kSlabGranularity;
    const uint64_t copied = dense ? DenseBytes(request, grid, here) : 0;  // beside the next slab
    const uint64_t bits = dense ? BitGrid::BytesFor({grid.dims[0], grid.dims[1], here}) : 0;
    return PredictSlabBytes(request, grid, mesh, here) + copied + bits <= room && copied <= kMostSlabBytes;
  };
  while (layers > 1 && !fits()) layers = (layers + 1) / 2;
  return std::min(depth, layers * kSlabGranularity);
}

}  // namespace voxelpipe
