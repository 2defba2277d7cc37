#include "cuda/plan/occupancy_plan.h"

#include <algorithm>

namespace voxelpipe::cuda {
namespace {

// An unordered mesh is rasterized in spatial order if the grid exceeds the cache kCacheTimes-fold; its largest
// triangles are drawn while the grid is cleared if it exceeds 1/kCacheTimes of the cache.
constexpr uint64_t kCacheTimes = 8;
constexpr uint64_t kMaxTrianglesOfBlocks = 1 << 18;
constexpr int kSharedLanes = 2;

}  // namespace

OccupancyPlan PlanOccupancy(const OccupancyInputs& in) {
  const auto exceeds_cache = [&](uint64_t bytes) { return in.cache_bytes != 0 && bytes > in.cache_bytes / 2; };
  const auto nx = uint64_t(in.dims[0]), ny = uint64_t(in.dims[1]), nz = uint64_t(in.dims[2]);
  const uint64_t face = std::max({nx * ny, ny * nz, nz * nx});
  OccupancyPlan plan;
  const bool few = in.triangles <= kMaxTrianglesOfBlocks && in.triangles * 8 <= face;
  if (in.triangles > 0 && in.alone && !in.without_blocks && exceeds_cache(in.bytes) && few) {
    plan.path = OccupancyPath::kBlocks;
    return plan;
  }
  if (in.triangles > 0 && in.alone && in.triangles <= in.single_launch_triangles) {
    plan.path = OccupancyPath::kSingleLaunch;
    return plan;
  }
  const bool ordered = in.has_ordered_copy(), far_beyond = exceeds_cache(in.bytes / kCacheTimes);
  plan.keeps_together = ordered && far_beyond;
  plan.draws_largest = ordered && in.alone && exceeds_cache(in.bytes * kCacheTimes);
  if (in.triangles == 0) {
    plan.path = OccupancyPath::kClear;
    return plan;
  }
  if (in.alone && !in.without_bricks && far_beyond && !ordered && in.fixed_point && in.triangles * 2 <= face) {
    plan.path = OccupancyPath::kBricks;
    plan.keeps_together = true;
    return plan;
  }
  // More than one lane for triangles of many rows: on average more than one voxel of the grid's largest face each.
  if (!ordered && in.triangles <= in.resident_triangles) plan.lanes_per_triangle = 1;
  if (!ordered && in.triangles < std::min(face, in.resident_triangles / kSharedLanes)) {
    plan.lanes_per_triangle = kSharedLanes;
  }
  const bool small = in.bytes <= in.kernel_clear_bytes;
  if (in.fixed_point && !small && plan.lanes_per_triangle != kSharedLanes && in.needs_rows()) {
    plan.path = OccupancyPath::kRows;
    plan.rows_together = in.alone && exceeds_cache(in.bytes);
    plan.lanes_per_triangle = 0;
    return plan;
  }
  plan.path = plan.lanes_per_triangle > 0 ? OccupancyPath::kResident : OccupancyPath::kTriangles;
  plan.clears_in_kernel = small && !plan.draws_largest;
  return plan;
}

}  // namespace voxelpipe::cuda
