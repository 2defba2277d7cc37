#include "cpu/footprint.h"

#include <tbb/info.h>

#include <algorithm>
#include <cmath>
#include <span>

#include "cpu/a_buffer.h"
#include "cpu/base/enclosed.h"
#include "cpu/base/task_sizes.h"
#include "cpu/base/tile_values.h"
#include "cpu/run_state.h"
#include "grid/bit_grid.h"
#include "pipeline/plan/footprint_parts.h"
#include "pipeline/stages/target_rules.h"
#include "raster/row_bits_fit.h"

namespace voxelpipe::cpu {
namespace {

using namespace footprint;

// True if the bits of a fill are set in the coverage.
bool JoinsCoverage(const VoxelizeRequest& request) {
  return request.result == ResultKind::kDense &&
         std::all_of(request.targets.begin(), request.targets.end(),
                     [](const TargetSpec& t) { return IsOccupancyBit(t) && t.clear == 0 && FillBit(t); });
}

// The number of bit grids of a slab besides the targets: coverage, inside bits of a fill, bits and presence of targets
// that are not the coverage itself.
int BitGrids(const VoxelizeRequest& request, const GridSpec& grid) {
  if (request.result == ResultKind::kBuckets) return 0;
  const bool dense = request.result == ResultKind::kDense;
  const TargetSpec& last = request.targets.back();
  const bool handed_over = dense && request.fill == Fill::kNone && IsOccupancyBit(last) && last.clear == 0 &&
                           grid.dims[0] % 32 == 0;  // rows of whole words: the coverage becomes the result
  int grids = (handed_over ? 0 : 1) + (request.fill == Fill::kNone || JoinsCoverage(request) ? 0 : 1);
  for (const TargetSpec& target : request.targets) {
    const bool in_tiles = request.result == ResultKind::kSparse;  // tiles keep their bits
    if (target.format == VoxelFormat::kBit && !IsOccupancyBit(target) && !in_tiles) ++grids;
    const bool of_owner = HoldsOwner(request, target) && !(IsOccupancyBit(target) && FillBit(target));
    if (OwnPresence(target) || of_owner) ++grids;
    if (of_owner && IsOccupancyBit(target) && !in_tiles) ++grids;  // its bits
  }
  return grids;
}

double BitGridBytes(const GridSpec& grid, int64_t layers) {
  return Pooled(double(BitGrid::BytesFor({grid.dims[0], grid.dims[1], layers})));
}
double BitGridBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers) {
  return BitGrids(request, grid) * BitGridBytes(grid, layers);
}

// In: the layers of a slab, fewer than the grid's. Out: what the thinner last slab takes beside the idle blocks of the
// others. It is cut from them unless it is much smaller (page_pool.cpp); a run over the slabs for each of several
// targets takes the thicker blocks anew.
double LastSlabBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t depth, Delivery delivery) {
  const int64_t layers = grid.dims[2] % depth;
  const bool dense = request.result == ResultKind::kDense;
  const bool again =
      dense && delivery == Delivery::kStream && (request.targets.size() > 1 || request.layout == Layout::kPlanar);
  const auto own = [again](double last, double other) { return again || other - last > last / 2 ? last : 0; };
  double bytes = BitGrids(request, grid) * own(BitGridBytes(grid, layers), BitGridBytes(grid, depth));
  if (!dense) return bytes;
  const uint64_t layer = uint64_t(grid.dims[0]) * uint64_t(grid.dims[1]);
  for (const TargetSpec& target : request.targets) {
    const auto of = [&](int64_t z) { return Pooled(double(TargetBytes(target, layer * uint64_t(z)))); };
    bytes += own(of(layers), of(depth));
  }
  return bytes;
}

// Fixed costs of the run besides grids: arenas, tile buffers of each thread, the bits of the measurement.
constexpr double kBaseBytes = 4 << 20;
constexpr double kTileListBytes = sizeof(TileValues) + sizeof(uint32_t);  // sparse: of a tile besides its values
constexpr double kTileFragmentBytes = sizeof(TileFragments) + sizeof(std::span<const RowFragments>);  // buckets
// Slabs of sparse results: below, thinner ones save little, and each one looks at all triangles.
constexpr double kThinSlabBytes = 16 << 20, kThinSlabBytesATriangle = 256;
constexpr double kRunBytes = 2.2 * sizeof(TileRun);  // collected by bucket, then joined
constexpr double kBlocks = 1.3;                      // lists that grow by blocks, the last of which is not full

// True if rows are set without tiles, as in run_state.h.
bool PlainBits(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh) {
  const bool owned = std::any_of(request.targets.begin(), request.targets.end(), [&](const TargetSpec& target) {
    return HoldsOwner(request, target) && !FillBit(target);
  });
  return footprint::PlainBits(request) && !owned && RowBitsFit(grid, mesh.triangles);
}

// What all tiles keep until the lists are made: values for a sparse result, fragments for buckets.
double KeptBytes(const VoxelizeRequest& request, const Surface& surface, bool plain_bits) {
  if (request.result == ResultKind::kDense) return 0;
  if (request.result == ResultKind::kBuckets) {
    return kBlocks * sizeof(RowFragments) * surface.rows + kTileFragmentBytes * surface.tiles;
  }
  if (plain_bits) return 0;
  double value = 0;
  for (const TargetSpec& target : request.targets) {
    if (IsOccupancyBit(target)) continue;
    value += target.format == VoxelFormat::kBit ? 1 : double(target.components * BitsPerComponent(target.format)) / 8;
  }
  return kBlocks * value * surface.voxels + kTileListBytes * surface.tiles;
}

double ShadedBytes(const VoxelizeRequest& request, const MeshSize& mesh) {
  if (mesh.extent.held_bytes != 0 || request.vertex_shader.name == "identity") return double(mesh.extent.held_bytes);
  return double(mesh.vertices) * (sizeof(Vec3d) + sizeof(Vec3f));  // not known yet: positions and normals
}

// True if the coverage of a slab that is the whole grid is the shell of a flood whatever the mesh's materials. Then it
// is so in flood_fill.cpp too.
bool CoverageIsShell(const VoxelizeRequest& request, bool plain_bits) {
  return request.coverage == Coverage::kConservative &&
         (plain_bits || std::any_of(request.targets.begin(), request.targets.end(), [](const TargetSpec& target) {
            return IsOccupancyBit(target) || !OwnPresence(target);
          }));
}

// The vertices and triangles that the stages keep for the whole run, and the maximum beside them while triangles are
// sorted.
struct MeshWork {
  double kept = 0, sorting = 0;
};
MeshWork MeshWorkBytes(const VoxelizeRequest& request, const MeshSize& mesh, const Surface& surface, bool plain_bits,
                       bool draws_shell) {
  const double vertices = double(mesh.vertices);
  constexpr double kCode = 8;  // a vertex's voxel
  MeshWork work;
  work.kept = ShadedBytes(request, mesh) + Pooled(vertices * kCode);
  if (plain_bits) {
    if (CastsLines(request.fill)) work.kept += Pooled(vertices * sizeof(Vec3d));
    // The shell of a flood is conservative.
    if (draws_shell && request.coverage != Coverage::kConservative) work.kept += Pooled(vertices * kCode);
    return work;
  }
  work.kept += Pooled(vertices * sizeof(Vec3d)) + Pooled(8 * surface.pairs) + kRunBytes * surface.tiles;
  // Each thread reserves a little more than one pair a triangle.
  work.sorting = 8 * std::max(kBlocks * surface.pairs, 1.125 * double(mesh.triangles));
  if (draws_shell) work.kept += Pooled(vertices * kCode);
  return work;
}

// Lists of triangles by slab and of crossings by block, which each thread collects in chunks of its own while it
// rasterizes and fills.
double BinBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, const Surface& surface,
                int64_t layers, bool plain_bits, bool draws_shell) {
  const int cores = tbb::info::default_concurrency();
  const double threads = std::min(double(request.threads > 0 ? std::min(request.threads, cores) : cores),
                                  std::ceil(double(mesh.triangles) / kTriangleGrain));
  double bytes = 0;
  if (plain_bits || draws_shell) {
    // Of a slab of parts once more, by part.
    const double lists = FillsParts(request) ? 2 : 1;
    bytes += lists * 4 * (double(mesh.triangles) + surface.layers / kMaxSlabLayers) + threads * kBinChunkBytes;
  }
  const double crossing_bytes = FillsParts(request) ? 32 * kBlocks : 4;
  if (CastsLines(request.fill)) bytes += crossing_bytes * surface.crossings + 2 * threads * kBinChunkBytes;
  if (request.fill == Fill::kNonzero && !FillsParts(request)) {
    // The signed counters of a block of rows for each thread.
    const double all = double(BitGrid::BytesFor({grid.dims[0], grid.dims[1], layers}));
    const double row = double(BitGrid::BytesFor({grid.dims[0], 1, 1}));
    const double block = std::max({double(kSumBlockBytes), row, all / kMaxLineBlocks});
    bytes += kSumsOfBit * std::min(all, std::max(1.0, threads) * block);
  }
  return bytes;
}

// In: the layers of a slab of a sparse result that the limits allow. Out: fewer where its bit grids, which are cleared
// and read whole, are most of its memory: thin slabs take less of it, and stay in the caches.
int64_t ThinSlabDepth(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, int64_t depth,
                      double list_bytes) {
  const double least = std::max({kThinSlabBytes, 4 * list_bytes, kThinSlabBytesATriangle * double(mesh.triangles)});
  while (depth > kSlabGranularity && BitGridBytes(request, grid, depth) > least) depth /= 2;
  return std::min(grid.dims[2], (depth + kSlabGranularity - 1) / kSlabGranularity * kSlabGranularity);
}

}  // namespace

Footprint PredictFootprint(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                           const Surface& surface, const PlanLimits& limits, Delivery delivery) {
  const bool dense = request.result == ResultKind::kDense, plain_bits = PlainBits(request, grid, mesh);
  Footprint out;
  out.result_bytes = ResultBytes(request, grid, surface);
  // The bytes of the lists of a slab, then of the whole slab.
  const auto lists = [&](int64_t layers) {
    if (dense) return 0.0;
    const Surface here = MostOfSlab(surface, grid, layers);
    return ListBytes(request, here, true) + KeptBytes(request, here, plain_bits);
  };
  const auto slab_bytes = [&](int64_t layers) {
    double bytes = dense ? DenseBytes(request, grid, layers) : lists(layers);
    if (request.result == ResultKind::kSparse && !plain_bits) bytes += 4 * TilesOfGrid(grid, layers);
    // Of each voxel the rank of its owner.
    if (FillsParts(request)) bytes += Pooled(2 * double(grid.dims[0]) * double(grid.dims[1]) * double(layers));
    return bytes + BitGridBytes(request, grid, layers);
  };
  out.slab_depth = SlabDepth(grid, limits, !dense || delivery == Delivery::kStream, slab_bytes);
  if (request.result == ResultKind::kSparse && limits.slab_depth == 0) {
    out.slab_depth = ThinSlabDepth(request, grid, mesh, out.slab_depth, lists(grid.dims[2]));
  }
  const bool one_slab = out.slab_depth >= grid.dims[2];
  const bool flood = request.fill == Fill::kFlood;
  const bool draws_shell = flood && !(one_slab && CoverageIsShell(request, plain_bits));
  const MeshWork work = MeshWorkBytes(request, mesh, surface, plain_bits, draws_shell);
  double slab =
      slab_bytes(out.slab_depth) + BinBytes(request, grid, mesh, surface, out.slab_depth, plain_bits, draws_shell);
  double list = lists(out.slab_depth);
  if (!one_slab && dense && delivery == Delivery::kMemory) slab += DenseBytes(request, grid, grid.dims[2]);
  if (!one_slab) slab += LastSlabBytes(request, grid, out.slab_depth, delivery);
  if (!one_slab && !dense) {
    // The lists of all slabs, and the scratch memory of the last one's lists or, at the end, the array into which the
    // lists of one kind are joined.
    const Surface here = MostOfSlab(surface, grid, out.slab_depth);
    const double slabs = std::ceil(double(grid.dims[2]) / double(out.slab_depth));
    const double last = ListBytes(request, here, true);
    const double all = std::min(slabs * last, HeldListBytes(request, surface, here, slabs));
    const double held =
        all - last + std::max(0.0, LargestListBytes(request, surface) - KeptBytes(request, here, plain_bits));
    slab += held;
    list += held;
  }
  if (flood) {
    // The shell, unless it is the coverage, and what it encloses: in one slab the inside, or it replaces the coverage,
    // from whose idle block the result is cut unless it is much smaller (page_pool.cpp).
    const double whole = BitGridBytes(grid, grid.dims[2]);
    slab += (draws_shell ? one_slab ? 1 : 2 : 0) * whole;
    if (one_slab && JoinsCoverage(request)) {
      const double result = DenseBytes(request, grid, grid.dims[2]);
      slab += whole - result > result / 2 ? whole : std::max(0.0, whole - result);
    }
    slab += double(EnclosedWorkBytes(grid.dims));
  }
  Sum peak;
  peak += kBaseBytes;
  peak += work.kept;
  peak += std::max(work.sorting, slab);
  out.peak_bytes = peak;
  Sum listed;
  if (!plain_bits) list = std::max(list, work.sorting) + Pooled(8 * surface.pairs);
  listed += list;
  out.list_bytes = listed;
  return out;
}

}  // namespace voxelpipe::cpu
