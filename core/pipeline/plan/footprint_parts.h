// What the predictions of all backends share.
#pragma once

#include <algorithm>
#include <cstdint>

#include "pipeline/plan/footprint.h"
#include "pipeline/plan/plan.h"
#include "pipeline/plan/surface.h"

namespace voxelpipe::footprint {

// Sums of bytes that end at the largest number instead of beginning anew. Estimates come as doubles.
class Sum {
 public:
  Sum& operator+=(double bytes) {
    bytes_ += bytes > 0 ? bytes : 0;
    return *this;
  }
  operator uint64_t() const { return bytes_ < 0x1p63 ? uint64_t(bytes_) : uint64_t{1} << 63; }

 private:
  double bytes_ = 0;
};

bool IsOccupancyBit(const TargetSpec& target);
// True if the target's shader can drop fragments, so that it keeps a presence bit of its own.
bool OwnPresence(const TargetSpec& target);
// No targets but coverage itself: rows are set without tiles.
bool PlainBits(const VoxelizeRequest& request);
// Bytes of one voxel or fragment in all targets.
double ValueBytes(const VoxelizeRequest& request);

// What a block of the page pool of so many bytes takes.
double Pooled(double bytes);
// The same of a pinned block (cuda/device/pinned.cpp), which has one of four sizes an octave.
inline double PooledPinned(double bytes) {
  return Pooled(1.125 * bytes);
}

// Tiles of 32x8x8 voxels over `layers` layers.
double TilesOfGrid(const GridSpec& grid, int64_t layers);

// Dense targets over `layers` layers.
double DenseBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers);
// Arrays of a sparse or bucketed result; `pooled`: with what blocks are rounded up to.
double ListBytes(const VoxelizeRequest& request, const Surface& surface, bool pooled);
// The same of all slabs together, each with arrays of its own, none of which has more than `slab`.
double HeldListBytes(const VoxelizeRequest& request, const Surface& surface, const Surface& slab, double slabs);
double LargestListBytes(const VoxelizeRequest& request, const Surface& surface);
// The result as its reader gets it.
uint64_t ResultBytes(const VoxelizeRequest& request, const GridSpec& grid, const Surface& surface);

// A slab deep enough for the whole grid, or a multiple of the granularity.
template <typename Bytes>
int64_t SlabDepth(const GridSpec& grid, const PlanLimits& limits, bool bounded, const Bytes& slab_bytes) {
  int64_t depth = grid.dims[2];
  if (limits.slab_depth > 0) {
    depth = std::min(depth, limits.slab_depth);
  } else if (bounded) {
    while (depth > kSlabGranularity && slab_bytes(depth) > double(limits.slab_bytes)) depth = depth / 2;
  }
  if (depth == grid.dims[2]) return depth;
  return std::min(grid.dims[2], (depth + kSlabGranularity - 1) / kSlabGranularity * kSlabGranularity);
}

}  // namespace voxelpipe::footprint
