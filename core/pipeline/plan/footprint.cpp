#include "pipeline/plan/footprint.h"

#include <tbb/info.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "grid/bit_grid.h"
#include "grid/page_pool.h"
#include "job/result.h"
#include "pipeline/plan/footprint_parts.h"
#include "pipeline/stages/target_rules.h"
#include "raster/tiles.h"
#include "shaders/catalog.h"

namespace voxelpipe {
namespace footprint {

bool IsOccupancyBit(const TargetSpec& target) {
  return target.format == VoxelFormat::kBit && target.shader.name == "occupancy";
}

bool OwnPresence(const TargetSpec& target) {
  const ShaderInfo* info = FindShader(ShaderStage::kFragment, target.shader.name);
  return info != nullptr && info->can_discard;
}

bool PlainBits(const VoxelizeRequest& request) {
  return request.result != ResultKind::kBuckets &&
         std::all_of(request.targets.begin(), request.targets.end(), IsOccupancyBit);
}

double ValueBytes(const VoxelizeRequest& request) {
  double bytes = 0;
  for (const TargetSpec& target : request.targets) {
    bytes += double(target.components) * double(BitsPerComponent(target.format)) / 8;
  }
  return bytes;
}

double Pooled(double bytes) {
  if (bytes < double(kPooledBytes)) return bytes;
  return std::ceil(bytes / double(kPooledUnit)) * double(kPooledUnit);
}

double TilesOfGrid(const GridSpec& grid, int64_t layers) {
  return std::ceil(double(grid.dims[0]) / 32) * std::ceil(double(grid.dims[1]) / 8) * std::ceil(double(layers) / 8);
}

double DenseBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers) {
  const double voxels = double(grid.dims[0]) * double(grid.dims[1]) * double(layers);
  double bytes = 0;
  for (const TargetSpec& target : request.targets) {
    bytes += Pooled(std::ceil(voxels * double(target.components) * double(BitsPerComponent(target.format)) / 8));
  }
  return bytes;
}

double BitGridBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers) {
  if (request.result == ResultKind::kBuckets) return 0;
  const bool dense = request.result == ResultKind::kDense;
  const TargetSpec& last = request.targets.back();
  const bool handed_over = dense && request.fill == Fill::kNone && IsOccupancyBit(last) && last.clear == 0 &&
                           grid.dims[0] % 32 == 0;  // rows of whole words: the coverage becomes the result
  const bool joined = dense && std::all_of(request.targets.begin(), request.targets.end(), [](const TargetSpec& t) {
                        return IsOccupancyBit(t) && t.clear == 0 && FillBit(t);
                      });  // a fill's bits are set in the coverage
  int grids = (handed_over ? 0 : 1) + (request.fill == Fill::kNone || joined ? 0 : 1);
  for (const TargetSpec& target : request.targets) {
    const bool in_tiles = request.result == ResultKind::kSparse;  // their bits stay with their tiles
    if (target.format == VoxelFormat::kBit && !IsOccupancyBit(target) && !in_tiles) ++grids;
    if (OwnPresence(target)) ++grids;
  }
  return grids * Pooled(double(BitGrid::BytesFor({grid.dims[0], grid.dims[1], layers})));
}

namespace {

// Calls visit(bytes) for each array of a list.
template <typename Visit>
void ForEachList(const VoxelizeRequest& request, const Surface& surface, const Visit& visit) {
  const bool buckets = request.result == ResultKind::kBuckets;
  const double listed = buckets ? surface.fragments : surface.voxels + surface.inside;
  if (buckets) {
    visit(8 * surface.voxels);
    visit(8 * (surface.voxels + 1));
    visit(4 * surface.fragments);
  } else {
    visit(8 * surface.filled_bricks);
    visit(64 * surface.filled_bricks);
  }
  for (const TargetSpec& target : request.targets) {
    visit(listed * double(target.components) * double(BitsPerComponent(target.format)) / 8);
  }
}

}  // namespace

double ListBytes(const VoxelizeRequest& request, const Surface& surface, bool pooled) {
  double all = 0;
  ForEachList(request, surface, [&](double bytes) { all += pooled ? Pooled(bytes) : bytes; });
  return all;
}

double HeldListBytes(const VoxelizeRequest& request, const Surface& surface, const Surface& slab, double slabs) {
  double all = 0;
  std::vector<double> most;  // of a slab, array by array
  ForEachList(request, slab, [&](double bytes) { most.push_back(bytes); });
  size_t array = 0;
  ForEachList(request, surface, [&](double bytes) {
    // Half a unit is left over on average of each block of the pool.
    const double blocks = most[array++] < double(kPooledBytes) ? 0 : std::min(slabs, bytes / double(kPooledBytes));
    all += bytes + blocks * double(kPooledUnit) / 2;
  });
  return all;
}

double LargestListBytes(const VoxelizeRequest& request, const Surface& surface) {
  double largest = 0;
  ForEachList(request, surface, [&](double bytes) { largest = std::max(largest, Pooled(bytes)); });
  return largest;
}

}  // namespace footprint

namespace {

using namespace footprint;

// Fixed costs of the run besides grids: arenas, tile buffers of each thread, the bits of the measurement.
constexpr double kBaseBytes = 4 << 20;
constexpr double kTileListBytes = 264 + 4;   // sparse: what is kept of a tile besides its values
constexpr double kTileFragmentBytes = 1320;  // buckets: the rows of a tile
constexpr double kRowBytes = 12;             // buckets: a run of voxels in a row
constexpr double kRunBytes = 2.2 * 16;       // of equal tiles among the pairs, gathered by bucket and then together
constexpr double kBlocks = 1.3;              // lists that grow by blocks, the last of which is not full

// What is kept of all tiles until a list is made of them: of a sparse result the values, of buckets the fragments.
double KeptBytes(const VoxelizeRequest& request, const Surface& surface) {
  if (request.result == ResultKind::kDense) return 0;
  if (request.result == ResultKind::kBuckets) {
    return kBlocks * kRowBytes * surface.rows + kTileFragmentBytes * surface.tiles;
  }
  if (PlainBits(request)) return 0;
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

// Vertices and triangles as the stages keep them for the whole run, and the most beside them while triangles are
// sorted.
struct MeshWork {
  double kept = 0, sorting = 0;
};
MeshWork MeshWorkBytes(const VoxelizeRequest& request, const MeshSize& mesh, const Surface& surface) {
  const double vertices = double(mesh.vertices);
  constexpr double kCode = 8;  // a vertex's voxel
  MeshWork work;
  work.kept = ShadedBytes(request, mesh) + Pooled(vertices * kCode);
  if (PlainBits(request)) {
    if (CastsLines(request.fill)) work.kept += Pooled(vertices * sizeof(Vec3d));
    // The shell of a flood is conservative.
    const bool shell = request.fill == Fill::kFlood && request.coverage != Coverage::kConservative;
    if (shell) work.kept += Pooled(vertices * kCode);
    return work;
  }
  work.kept += Pooled(vertices * sizeof(Vec3d)) + Pooled(8 * surface.pairs) + kRunBytes * surface.tiles;
  // Each thread begins with room for a little more than one pair of a triangle.
  work.sorting = 8 * std::max(kBlocks * surface.pairs, 1.125 * double(mesh.triangles));
  if (request.fill == Fill::kFlood) work.kept += Pooled(vertices * kCode);  // of the shell's rows
  return work;
}

// Lists of triangles by slab and of crossings by block, which threads gather while they rasterize and fill, each in
// chunks of its own.
double BinBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, const Surface& surface,
                int64_t layers) {
  constexpr double kChunk = 2 << 20, kTrianglesOfTask = 1 << 12;
  const int cores = tbb::info::default_concurrency();
  const double threads = std::min(double(request.threads > 0 ? std::min(request.threads, cores) : cores),
                                  std::ceil(double(mesh.triangles) / kTrianglesOfTask));
  double bytes = 0;
  if (PlainBits(request) || request.fill == Fill::kFlood) {
    bytes += 4 * (double(mesh.triangles) + surface.layers / 16) + threads * kChunk;
  }
  if (CastsLines(request.fill)) bytes += 4 * surface.crossings + 2 * threads * kChunk;
  if (request.fill == Fill::kNonzero) {
    // The signed counters of a block of rows for each thread (cpu/solid_fill.cpp).
    constexpr double kLeastBlock = 1 << 20, kBlocksOfGrid = 2048;
    const double all = 32 * double(BitGrid::BytesFor({grid.dims[0], grid.dims[1], layers}));
    const double row = 32 * double(BitGrid::BytesFor({grid.dims[0], 1, 1}));
    bytes += std::min(all, std::max(1.0, threads) * std::max({kLeastBlock, row, all / kBlocksOfGrid}));
  }
  return bytes;
}

}  // namespace

uint64_t DenseResultBytes(const VoxelizeRequest& request, const GridSpec& grid) {
  if (request.result != ResultKind::kDense) return 0;
  Sum bytes;
  for (const TargetSpec& t : request.targets) {
    bytes += std::ceil(double(grid.voxels()) * double(t.components) * double(BitsPerComponent(t.format)) / 8);
  }
  return bytes;
}

Footprint PredictHostFootprint(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                               const Surface& surface, const PlanLimits& limits, Delivery delivery) {
  const bool dense = request.result == ResultKind::kDense;
  Footprint out;
  Sum result;
  result += dense ? double(DenseResultBytes(request, grid)) : ListBytes(request, surface, false);
  out.result_bytes = result;
  // What lists of a slab take; and all that a slab takes.
  const auto lists = [&](int64_t layers) {
    if (dense) return 0.0;
    const Surface here = MostOfSlab(surface, grid, layers);
    return ListBytes(request, here, true) + KeptBytes(request, here);
  };
  const auto slab_bytes = [&](int64_t layers) {
    double bytes = dense ? DenseBytes(request, grid, layers) : lists(layers);
    if (request.result == ResultKind::kSparse && !PlainBits(request)) bytes += 4 * TilesOfGrid(grid, layers);
    return bytes + BitGridBytes(request, grid, layers);
  };
  out.slab_depth = SlabDepth(grid, limits, !dense || delivery == Delivery::kStream, slab_bytes);
  const bool one_slab = out.slab_depth >= grid.dims[2];
  const MeshWork work = MeshWorkBytes(request, mesh, surface);
  double slab = slab_bytes(out.slab_depth) + BinBytes(request, grid, mesh, surface, out.slab_depth);
  double list = lists(out.slab_depth);
  if (!one_slab && dense && delivery == Delivery::kMemory) slab += DenseBytes(request, grid, grid.dims[2]);
  // A stream of several targets goes over the slabs again: the pool has blocks of a last one that is thinner then, and
  // those of the others.
  if (!one_slab && dense && delivery == Delivery::kStream)
    slab += DenseBytes(request, grid, grid.dims[2] % out.slab_depth);
  if (!one_slab && !dense) {
    // The lists of all slabs, and what the last one's are made of or, in the end, the array to which those of one kind
    // are joined.
    const Surface here = MostOfSlab(surface, grid, out.slab_depth);
    const double slabs = std::ceil(double(grid.dims[2]) / double(out.slab_depth));
    const double last = ListBytes(request, here, true);
    const double all = std::min(slabs * last, HeldListBytes(request, surface, here, slabs));
    const double held = all - last + std::max(0.0, LargestListBytes(request, surface) - KeptBytes(request, here));
    slab += held;
    list += held;
  }
  if (request.fill == Fill::kFlood) {
    // The shell and what is reached from outside; one slab's inside takes the place of the shell.
    slab += (one_slab ? 1 : 2) * Pooled(double(BitGrid::BytesFor(grid.dims)));
  }
  Sum peak;
  peak += kBaseBytes;
  peak += work.kept;
  peak += std::max(work.sorting, slab);
  out.peak_bytes = peak;
  Sum listed;
  if (!PlainBits(request)) list = std::max(list, work.sorting) + Pooled(8 * surface.pairs);
  listed += list;
  out.list_bytes = listed;
  return out;
}

}  // namespace voxelpipe
