// Predicts bytes by the same rules by which the stages allocate: grids, lists, pools, accumulators.
#include "cuda/plan/footprint.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "cuda/plan/path_plan.h"
#include "cuda/primitives/list_sizes.h"
#include "cuda/primitives/span.h"
#include "cuda/primitives/voxel_code.h"
#include "grid/bit_grid.h"
#include "job/result.h"
#include "pipeline/plan/footprint_parts.h"
#include "pipeline/stages/target_rules.h"
#include "raster/row_bits_fit.h"
#include "raster/tiles.h"

namespace voxelpipe::cuda {
namespace {

using namespace footprint;

constexpr double kBaseBytes = 4 << 20;
// So many runs that make lists have room for a slab each in the working memory.
constexpr uint64_t kRunsInWorkingMemory = 4;

bool HasOwners(const TargetSpec& target) {
  return target.blend == Blend::kReplace || target.blend == Blend::kFirst;
}

// True if a target holds the fragments of owners alone, as DescribeTargets decides.
bool IsOfOwner(const VoxelizeRequest& request, const TargetSpec& target) {
  return HoldsOwner(request, target) && !(IsOccupancyBit(target) && FillBit(target));
}
// True if a target's value is the coverage itself.
bool IsCoverage(const VoxelizeRequest& request, const TargetSpec& target) {
  return IsOccupancyBit(target) && !IsOfOwner(request, target);
}
// True if rows of voxels are set in the coverage and nothing else is wanted.
bool SetsRows(const VoxelizeRequest& request) {
  return PlainBits(request) && !FillsParts(request);
}

// What the path depends on. Assumes that values are uniform over a triangle: the vertex shader, which decides it, has
// not run yet.
PathTarget PathTargetOf(const TargetSpec& spec) {
  return {spec.format, spec.blend, spec.components, spec.clear == 0, IsOccupancyBit(spec), OwnPresence(spec), true};
}

// Bytes of the brick pool of Path::kBricks for `layers` layers, and of the list of owners; 0 if the path has none.
double PoolBytes(const VoxelizeRequest& request, const GridSpec& grid, const Surface& surface, int64_t layers) {
  if (request.fill != Fill::kNone || request.targets.size() != 1) return 0;
  if (!FitsBricks(PathTargetOf(request.targets[0]), request.result)) return 0;
  const bool owners = HasOwners(request.targets[0]);
  constexpr uint64_t kPlaceBytes = (kBrickCells + kMaskWordsOfBrick + 2) * sizeof(uint32_t);  // and a brick, a count
  const uint64_t x = uint64_t(grid.dims[0] + 7) / 8, y = uint64_t(grid.dims[1] + 7) / 8, z = uint64_t(layers + 7) / 8;
  const uint64_t pool = x * y * z * sizeof(uint32_t) + BrickPoolRoom(grid.dims[0], grid.dims[1], layers) * kPlaceBytes;
  return double(pool) + (owners ? 2 * sizeof(uint32_t) * surface.voxels : 0);
}

double BitsOf(const GridSpec& grid, int64_t layers) {
  return double(BitGrid::BytesFor({grid.dims[0], grid.dims[1], layers}));
}

// Bytes of the grids of a slab: dense targets, coverage, inside voxels of a fill, bits and presence of targets that
// have their own, and bits packed for the result; where parts are filled, the rank of each voxel's owner.
double DeviceGridBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers) {
  if (request.result == ResultKind::kBuckets) return 0;
  const bool dense = request.result == ResultKind::kDense, filled = request.fill != Fill::kNone;
  const double bits = BitsOf(grid, layers), voxels = double(grid.dims[0] * grid.dims[1]) * double(layers);
  double bytes = filled ? 2 * bits : bits;
  if (FillsParts(request)) bytes += 2 * voxels;
  for (const TargetSpec& target : request.targets) {
    if (OwnPresence(target) || IsOfOwner(request, target)) bytes += bits;
    if (target.format == VoxelFormat::kBit) {
      const bool coverage = IsCoverage(request, target);
      if (!coverage) bytes += bits;
      const bool as_it_is = coverage && !filled && target.clear == 0 && grid.dims[0] % 32 == 0;
      if (dense && !as_it_is) bytes += voxels / 8;
    } else if (dense) {
      bytes += voxels * double(target.components) * double(BitsPerComponent(target.format)) / 8;
    }
  }
  return bytes;
}

// Bytes of per-triangle lists: two queues of deferred triangles, records and their block masks, spans. A triangle that
// touches many voxels has a span for each of its rows.
double RecordBytes(const MeshSize& mesh, const Surface& surface) {
  constexpr double kQueues = 2 * sizeof(uint32_t), kRecord = 2 * sizeof(uint64_t), kSpan = sizeof(uint64_t);
  constexpr double kManyVoxels = 16, kMore = 17.0 / 16;
  const double triangles = double(mesh.triangles);
  const double rows = surface.fragments > kManyVoxels * triangles ? kMore * surface.rows : 0;
  return triangles * (kQueues + kRecord) + std::max(double(SpanRoom(mesh.triangles)), rows) * kSpan;
}

double BucketListBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                       const Surface& surface, int64_t layers) {
  const double cells = double(grid.dims[0] * grid.dims[1]) * double(layers);
  constexpr double pair = 2 * sizeof(uint32_t), of_sort = 1;
  const bool may_drop = std::all_of(request.targets.begin(), request.targets.end(), OwnPresence);
  const double places = std::min(surface.fragments, cells);  // upper bound of the number of buckets
  return RecordBytes(mesh, surface) + double(FragmentRoom(surface.fragments)) * pair +
         surface.fragments * (pair + of_sort + (may_drop ? 1 : 0)) + places * 2 * sizeof(uint64_t);
}

// Bytes of scatter blending: values of all triangles, and accumulators of covered voxels for targets that are not
// blended in place.
double DirectListBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                       const Surface& surface, int64_t layers) {
  const bool sparse = request.result == ResultKind::kSparse;
  double bytes = RecordBytes(mesh, surface), owner_list = 0;
  const bool values = std::any_of(request.targets.begin(), request.targets.end(),
                                  [](const TargetSpec& target) { return target.format != VoxelFormat::kBit; });
  if (sparse && values) bytes += sizeof(uint32_t) * (surface.voxels + surface.inside);  // the bits of listed voxels
  if (std::all_of(request.targets.begin(), request.targets.end(), OwnPresence)) bytes += BitsOf(grid, layers);
  bool ranked = false;
  if (FillsParts(request)) {  // the owner of each covered voxel, unless a target has it
    bytes += surface.voxels * sizeof(uint32_t) + BitsOf(grid, layers);
    ranked = true;
  }
  for (const TargetSpec& target : request.targets) {
    if (IsCoverage(request, target)) continue;
    const bool owners = HasOwners(target), bit = target.format == VoxelFormat::kBit;
    const bool sums = target.blend == Blend::kAdd || target.blend == Blend::kAverage;
    const double components = owners || bit ? 1 : double(target.components);
    const double cell = components * (sums ? sizeof(int64_t) : sizeof(uint32_t));
    const double count = target.blend == Blend::kAverage ? sizeof(uint32_t) : 0;
    const bool by_id = target.blend == Blend::kFirst && FillsParts(request);  // of each triangle its id
    if ((by_id || (!owners && !bit)) && !OwnPresence(target)) bytes += double(mesh.triangles) * cell;
    if (owners) owner_list = 3 * sizeof(uint32_t) * (surface.voxels + (sparse ? surface.inside : 0));
    if (!sparse && BlendsInPlace(PathTargetOf(target))) continue;
    bytes += surface.voxels * (cell + count);
    if (!std::exchange(ranked, true)) bytes += BitsOf(grid, layers);  // rank of each word
  }
  return bytes + owner_list;
}

// Bytes of the bricks into which few triangles are rasterized if the bit grid is much larger than the L2 cache
// (bit_bricks.cu): as much as the bit grid.
double BitPoolBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, int64_t layers) {
  constexpr double kLargeGrid = 160 << 20;  // four times the L2 cache of a large GPU
  const double x = double(grid.dims[0]), y = double(grid.dims[1]), z = double(layers), bits = BitsOf(grid, layers);
  const bool few = 2 * double(mesh.triangles) <= std::max({x * y, y * z, z * x});
  return request.coverage != Coverage::kCenter && few && bits > kLargeGrid ? bits : 0;
}

}  // namespace

// The vertex shader decides whether a target's value is uniform over a triangle, and has not run yet: takes the maximum
// over the possible paths.
double DeviceListBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                       const Surface& surface, int64_t layers) {
  if (SetsRows(request)) {
    const double queues = double(mesh.triangles) * 3 * sizeof(uint32_t);
    return queues + BitPoolBytes(request, grid, mesh, layers);
  }
  if (request.result == ResultKind::kBuckets) return BucketListBytes(request, grid, mesh, surface, layers);
  double bytes =
      std::max(DirectListBytes(request, grid, mesh, surface, layers), PoolBytes(request, grid, surface, layers));
  // Prefix counts of bricks and voxels.
  if (request.result == ResultKind::kSparse) bytes += 24 * TilesOfGrid(grid, layers);
  return bytes;
}

namespace {

// Vertices in index space, and triangles, which live for the whole run; once more where parts have an order of their
// own.
double MeshWorkBytes(const VoxelizeRequest& request, const MeshSize& mesh) {
  const double vertices = double(mesh.vertices);
  double held = double(mesh.extent.held_bytes);
  if (held == 0) {  // not loaded yet: positions and triangles, on the device and in pinned memory, and shader outputs
    const double shaded = request.vertex_shader.name != "identity" ? sizeof(Vec3d) + sizeof(Vec3f) : 0;
    held = vertices * (2 * sizeof(Vec3d) + shaded) +
           double(mesh.triangles) * (FillsParts(request) ? 3 : 2) * 3 * sizeof(uint32_t);
  }
  const bool places = !SetsRows(request) || CastsLines(request.fill);
  return held + (places ? vertices * (sizeof(VertexCode) + sizeof(Vec3d)) : 0);
}

// Signed counters of a nonzero fill over `layers` layers, for the rows of one batch (parity_fill.cu).
double SumBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers) {
  if (request.fill != Fill::kNonzero || FillsParts(request)) return 0;
  constexpr double kOfBit = 32;  // bytes of counters per byte of bits
  return std::min(kOfBit * BitsOf(grid, layers), std::max<double>(kMaxSumBytes, kOfBit * BitsOf(grid, 1)));
}

// Bytes of the crossings of parts (part_fill.cu): keys, twice, as they are sorted, the rows among them, the sort's own.
double CrossingBytes(const GridSpec& grid, const Surface& surface, int64_t layers) {
  constexpr double kOfSort = 1.0 / 8, kOfRow = 2 * sizeof(uint32_t);
  return double(CrossingRoom(surface.crossings)) * (2 + kOfSort) * sizeof(uint64_t) +
         double(grid.dims[1]) * double(layers) * kOfRow;
}

// Device bytes of a slab besides the mesh. `surface`: of the slab.
double DeviceSlabBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                       const Surface& surface, int64_t layers) {
  double lists = DeviceListBytes(request, grid, mesh, surface, layers);
  if (FillsParts(request)) {
    // Crossings are freed before fragments are listed; the queue of triangles that cross many lines is kept.
    lists = std::max(lists, CrossingBytes(grid, surface, layers)) + double(mesh.triangles) * sizeof(uint32_t);
  }
  double bytes = DeviceGridBytes(request, grid, layers) + lists;
  if (request.result != ResultKind::kDense) bytes += ListBytes(request, surface, false);
  // Flood fill: the surface, and the voxels reached from outside.
  if (request.fill == Fill::kFlood) bytes += BitsOf(grid, layers) + BitsOf(grid, grid.dims[2]);
  return bytes + SumBytes(request, grid, layers);
}

// `depth`, or if that is above `most` the depth of as few slabs as possible that are about equally deep: two buffers of
// a slab that is almost the whole grid would take twice its memory.
int64_t EvenSlabDepth(int64_t layers, int64_t depth, int64_t most) {
  if (depth <= most) return depth;
  const int64_t slabs = (layers + most - 1) / most, even = (layers + slabs - 1) / slabs;
  return (even + kSlabGranularity - 1) / kSlabGranularity * kSlabGranularity;
}

// In slabs of at most limits.slab_bytes where slabs are bounded.
Footprint FootprintInSlabs(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                           const Surface& surface, const PlanLimits& limits, Delivery delivery) {
  const bool dense = request.result == ResultKind::kDense;
  Footprint out;
  out.result_bytes = ResultBytes(request, grid, surface);
  const auto slab_bytes = [&](int64_t layers) {
    return DeviceSlabBytes(request, grid, mesh, MostOfSlab(surface, grid, layers), layers);
  };
  out.slab_depth = SlabDepth(grid, limits, !dense || delivery == Delivery::kStream, slab_bytes);
  if (!SetsRows(request) || !RowBitsFit(grid, mesh.triangles)) {
    out.slab_depth = EvenSlabDepth(grid.dims[2], out.slab_depth, MaxSlabLayers(grid.dims, GetSpanLimits().slab_bits));
  }
  const bool one_slab = out.slab_depth >= grid.dims[2];
  const Surface slab = MostOfSlab(surface, grid, out.slab_depth);
  // Two dense slabs are live at a time: one is rasterized while the other is copied to the host.
  const double at_once = dense && !one_slab ? 2 : 1;
  double device = MeshWorkBytes(request, mesh) + slab_bytes(out.slab_depth);
  if (dense && !one_slab) device += DeviceGridBytes(request, grid, out.slab_depth);
  double host = at_once * (dense ? DenseBytes(request, grid, out.slab_depth) : ListBytes(request, slab, true));
  if (!one_slab && dense && delivery == Delivery::kMemory) host += double(out.result_bytes);
  // The lists of all slabs and the joined result. Pinned memory returns to its pool, which keeps it.
  if (!one_slab && !dense) {
    const double slabs = std::ceil(double(grid.dims[2]) / double(out.slab_depth));
    host = PooledPinned(HeldListBytes(request, surface, slab, slabs)) + ListBytes(request, surface, true);
  }
  Sum peak, listed;
  peak += kBaseBytes + device + host;
  listed += kBaseBytes + device + (dense ? 0 : host);  // every device array asks before it grows
  out.peak_bytes = peak;
  out.list_bytes = listed;
  return out;
}

}  // namespace

Footprint PredictFootprint(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                           const Surface& surface, const PlanLimits& limits, Delivery delivery) {
  const auto within = [&](uint64_t slab_bytes) {
    PlanLimits of_slabs = limits;
    of_slabs.slab_bytes = slab_bytes;
    return FootprintInSlabs(request, grid, mesh, surface, of_slabs, delivery);
  };
  // Every slab goes through the whole mesh, and lists of several are joined on the host: few deep ones, where there is
  // room for other runs.
  const uint64_t deep = limits.max_working_bytes / kRunsInWorkingMemory;
  if (request.result != ResultKind::kDense && deep > limits.slab_bytes) {
    if (const Footprint few = within(deep); few.peak_bytes <= limits.max_working_bytes) return few;
  }
  return within(limits.slab_bytes);
}

uint64_t PredictSlabBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                          const Surface& surface, int64_t layers) {
  Sum bytes;
  bytes += DeviceSlabBytes(request, grid, mesh, MostOfSlab(surface, grid, layers), layers);
  return bytes;
}

int64_t FittingSlabDepth(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                         const Surface& surface, int64_t depth, uint64_t free_bytes) {
  if (PredictSlabBytes(request, grid, mesh, surface, depth) <= free_bytes) return depth;
  const bool dense = request.result == ResultKind::kDense;
  int64_t layers = (depth + kSlabGranularity - 1) / kSlabGranularity;  // in units of kSlabGranularity
  const auto fits = [&] {
    const int64_t here = layers * kSlabGranularity;
    const double copied = dense ? DenseBytes(request, grid, here) : 0;  // copied while the next slab runs
    Sum bytes;
    bytes += double(PredictSlabBytes(request, grid, mesh, surface, here)) + copied;
    if (dense) bytes += double(BitGrid::BytesFor({grid.dims[0], grid.dims[1], here}));
    return bytes <= free_bytes && copied <= double(kMaxSlabBytes);
  };
  while (layers > 1 && !fits()) layers = (layers + 1) / 2;
  return std::min(depth, layers * kSlabGranularity);
}

}  // namespace voxelpipe::cuda
