#include "pipeline/batch.h"

#include "pipeline/voxelize.h"

namespace voxelpipe {

std::vector<absl::StatusOr<VoxelizeResult>> VoxelizeBatch(const Backend& backend, std::span<const BatchItem> items,
                                                          int threads, const PlanLimits& limits, BatchStats* stats) {
  std::vector<absl::StatusOr<VoxelizeResult>> results(items.size());
  backend.RunEach(threads, items.size(), [&](size_t i) {
    const BatchItem& item = items[i];
    results[i] = VoxelizeInside(backend, *item.mesh, *item.request, *item.job, limits, item.on_plan);
  });
  if (stats != nullptr) stats->passes = uint32_t(items.size());
  return results;
}

}  // namespace voxelpipe
