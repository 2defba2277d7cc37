// What a run on a CUDA device takes: the device's lists (core/cuda) beside the targets, and what the host holds of the
// result.
#include <algorithm>
#include <cmath>

#include "grid/bit_grid.h"
#include "pipeline/footprint.h"
#include "pipeline/footprint_parts.h"
#include "pipeline/result.h"
#include "raster/tiles.h"

namespace voxelpipe {
namespace {

using namespace footprint;

constexpr double kBaseBytes = 4 << 20;
constexpr double kRecordBytes = 8;  // buckets: a run of voxels in a row takes 12, and holds about 1.5
constexpr double kTileFragmentBytes = 1350, kTileListBytes = 280;

// What is left of the parts of tiles that the CUDA backend splits (cuda/fine_args.cuh), until they are joined.
double PartBytes(const VoxelizeRequest& request, const Surface& surface) {
  constexpr double kMinPairs = 1024, kMostParts = 1024,
                   kPairsOfSplitTile = 2;  // of a part; parts; parts' pairs, more than
  constexpr double kGroup = 100 << 10;     // targets are blended in groups of so many bytes, or alone
  if (surface.pairs <= kPairsOfSplitTile * kMinPairs) return 0;
  const double parts = surface.pairs / std::max(kMinPairs, surface.pairs / kMostParts);
  double together = 0, largest = 0;
  for (const TargetSpec& target : request.targets) {
    const double component = target.blend == Blend::kAdd || target.blend == Blend::kAverage ? 8 : 4;
    const double of_tile = kTileVoxels * (4 + component * target.components);  // an owner or a count
    together += of_tile;
    largest = std::max(largest, of_tile);
  }
  return parts * (1 + 1 / kPairsOfSplitTile) * std::min(together, std::max(kGroup, largest));
}

// The pool of bricks from which the CUDA backend gives out those of a sparse result while triangles are drawn
// (cuda/brick_pool.h), of `layers` layers; 0 where it does not.
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

}  // namespace

// What the CUDA backend lists on the device. That is the same whether a target's value is uniform over a triangle,
// which is not known before the vertex shader ran, or not: pairs of tiles and triangles then take the place of records
// and spans.
double footprint::DeviceListBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                                  const Surface& surface, int64_t layers) {
  constexpr double kQueues = 2 * sizeof(uint32_t), kRecord = 2 * sizeof(uint64_t), kSpan = sizeof(uint64_t);
  constexpr double kOrder = sizeof(uint32_t);
  const double triangles = double(mesh.triangles);
  if (PlainBits(request)) return triangles * (kQueues + kOrder);
  // A triangle that touches many voxels has a span for each of its rows, others are records; there is room for a span
  // for every second.
  constexpr double kManyVoxels = 16, kVoxelsOfSpan = 2;
  const double rows = surface.fragments > kManyVoxels * triangles ? surface.fragments / kVoxelsOfSpan : 0;
  double bytes = triangles * (kQueues + kRecord) + std::max(triangles / 2 + double(1 << 18), rows) * kSpan;
  if (request.result == ResultKind::kBuckets) {
    constexpr double kFragment = 2 * (sizeof(uint32_t) + sizeof(uint32_t));  // voxel and triangle, to sort from and to
    constexpr double kBucket = 2 * sizeof(uint64_t);                         // room for as many as fragments
    return bytes + surface.fragments * (kFragment + kBucket);
  }
  bytes += triangles * kOrder;
  bytes = std::max(bytes, triangles * kQueues + PartBytes(request, surface));  // either the one way or the other
  const bool sparse = request.result == ResultKind::kSparse;
  const double kept = surface.voxels + (sparse ? surface.inside : 0);
  if (sparse) {
    constexpr double kRowRanks = 512;  // a brick
    bytes += kRowRanks * surface.filled_bricks + sizeof(uint32_t) * kept;
    bytes = std::max(bytes, triangles * kQueues + double(PoolBytes(request, grid, layers)));  // likewise
  }
  for (const TargetSpec& target : request.targets) {
    if (target.format == VoxelFormat::kBit) continue;
    const bool sums = target.blend == Blend::kAdd || target.blend == Blend::kAverage;
    const double cell = double(target.components) * (sums ? sizeof(int64_t) : sizeof(uint32_t));
    bytes += (triangles + kept) * cell;  // values, and what they are blended in
  }
  return bytes;
}

namespace {

// Vertices and triangles as the stages keep them for the whole run, and the pairs of a slab, which are held twice.
double MeshWorkBytes(const VoxelizeRequest& request, const MeshSize& mesh, const Surface& slab) {
  double shaded = double(mesh.extent.shaded_bytes);
  const double vertices = double(mesh.vertices), triangles = double(mesh.triangles);
  if (shaded == 0 && request.vertex_shader.name != "identity") shaded = vertices * (sizeof(Vec3d) + sizeof(Vec3f));
  if (PlainBits(request)) {
    constexpr double kCode = 8, kBinned = 4;  // a vertex's voxel; a triangle's id in the slabs' lists
    return shaded + vertices * (kCode + (CastsLines(request.fill) ? sizeof(Vec3d) : 0)) + triangles * kBinned;
  }
  return shaded + vertices * sizeof(Vec3d) + 2 * sizeof(uint64_t) * slab.pairs;
}

// The signed counters of a nonzero fill over `layers` layers: those of as many rows as take turns (cuda/solid_fill.cu).
double SumBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers) {
  if (request.fill != Fill::kNonzero) return 0;
  constexpr double kMost = 256 << 20;
  const double all = 32 * double(BitGrid::BytesFor({grid.dims[0], grid.dims[1], layers}));
  return std::min(all, std::max(kMost, 32 * double(BitGrid::BytesFor({grid.dims[0], 1, 1}))));
}

// What is kept of a slab's tiles or fragments until a list is made of them.
double KeptBytes(const VoxelizeRequest& request, const Surface& slab) {
  if (request.result == ResultKind::kDense || PlainBits(request)) return 0;
  if (request.result == ResultKind::kBuckets) return kRecordBytes * slab.fragments + kTileFragmentBytes * slab.tiles;
  return ValueBytes(request) * slab.voxels + kTileListBytes * slab.tiles;
}

}  // namespace

Footprint PredictDeviceFootprint(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                                 const Surface& surface, const PlanLimits& limits, Delivery delivery) {
  const bool dense = request.result == ResultKind::kDense;
  Footprint out;
  Sum result;
  result += dense ? DenseBytes(request, grid, grid.dims[2]) : ListBytes(request, surface, false);
  out.result_bytes = result;
  const auto slab_bytes = [&](int64_t layers) {
    const Surface here = MostOfSlab(surface, grid, layers);
    const double made =
        dense ? DenseBytes(request, grid, layers) : ListBytes(request, here, false) + KeptBytes(request, here);
    return made + BitGridBytes(request, grid, layers);
  };
  out.slab_depth = SlabDepth(grid, limits, !dense || delivery == Delivery::kStream, slab_bytes);
  const bool one_slab = out.slab_depth >= grid.dims[2];
  const Surface slab = MostOfSlab(surface, grid, out.slab_depth);  // tiles are sorted slab by slab
  Sum peak;
  peak += kBaseBytes + slab_bytes(out.slab_depth) + MeshWorkBytes(request, mesh, slab);
  peak += DeviceListBytes(request, grid, mesh, surface, out.slab_depth);
  if (dense && !one_slab) peak += slab_bytes(out.slab_depth);  // one is copied while another is made
  if (!one_slab && dense && delivery == Delivery::kMemory) peak += double(out.result_bytes);
  // The lists of all slabs, the last one's counted already, and what they are joined to.
  if (!one_slab && !dense) {
    const double earlier = 1 - double(out.slab_depth) / double(grid.dims[2]);
    peak += earlier * double(out.result_bytes) + LargestListBytes(request, surface);
  }
  // The shell and what is reached from outside; one slab's inside takes the place of the shell.
  if (request.fill == Fill::kFlood) peak += (one_slab ? 1 : 2) * double(BitGrid::BytesFor(grid.dims));
  peak += SumBytes(request, grid, out.slab_depth);
  out.peak_bytes = peak;
  return out;
}

uint64_t PredictSlabBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                          const Surface& surface, int64_t layers) {
  const bool dense = request.result == ResultKind::kDense;
  const Surface slab = MostOfSlab(surface, grid, layers);
  Sum bytes;
  bytes += BitGridBytes(request, grid, layers);
  bytes += DeviceListBytes(request, grid, mesh, slab, layers);
  bytes += dense ? DenseBytes(request, grid, layers) : ListBytes(request, slab, false);
  if (request.result == ResultKind::kSparse) bytes += KeptBytes(request, slab);
  if (request.fill == Fill::kFlood) bytes += 2 * double(BitGrid::BytesFor(grid.dims));
  bytes += SumBytes(request, grid, layers);
  return bytes;
}

int64_t FittingSlabDepth(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                         const Surface& surface, int64_t depth, uint64_t room) {
  if (PredictSlabBytes(request, grid, mesh, surface, depth) <= room) return depth;
  const bool dense = request.result == ResultKind::kDense;
  int64_t layers = (depth + kSlabGranularity - 1) / kSlabGranularity;  // in units of it
  const auto fits = [&] {
    const int64_t here = layers * kSlabGranularity;
    const double copied = dense ? DenseBytes(request, grid, here) : 0;  // beside the next slab
    Sum bytes;
    bytes += double(PredictSlabBytes(request, grid, mesh, surface, here)) + copied;
    if (dense) bytes += double(BitGrid::BytesFor({grid.dims[0], grid.dims[1], here}));
    return bytes <= room && copied <= double(kMostSlabBytes);
  };
  while (layers > 1 && !fits()) layers = (layers + 1) / 2;
  return std::min(depth, layers * kSlabGranularity);
}

}  // namespace voxelpipe
