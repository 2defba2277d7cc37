#include "pipeline/plan/footprint.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "grid/page_pool.h"
#include "pipeline/plan/footprint_parts.h"
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
  const auto along = [](int64_t voxels, int axis) { return std::ceil(double(voxels) / double(TileDim(axis))); };
  return along(grid.dims[0], 0) * along(grid.dims[1], 1) * along(layers, 2);
}

double DenseBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers) {
  const double voxels = double(grid.dims[0]) * double(grid.dims[1]) * double(layers);
  double bytes = 0;
  for (const TargetSpec& target : request.targets) {
    bytes += Pooled(std::ceil(voxels * double(target.components) * double(BitsPerComponent(target.format)) / 8));
  }
  return bytes;
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

uint64_t ResultBytes(const VoxelizeRequest& request, const GridSpec& grid, const Surface& surface) {
  if (request.result == ResultKind::kDense) return DenseResultBytes(request, grid);
  Sum bytes;
  bytes += ListBytes(request, surface, false);
  return bytes;
}

}  // namespace footprint

uint64_t DenseResultBytes(const VoxelizeRequest& request, const GridSpec& grid) {
  if (request.result != ResultKind::kDense) return 0;
  footprint::Sum bytes;
  for (const TargetSpec& t : request.targets) {
    bytes += std::ceil(double(grid.voxels()) * double(t.components) * double(BitsPerComponent(t.format)) / 8);
  }
  return bytes;
}

}  // namespace voxelpipe
