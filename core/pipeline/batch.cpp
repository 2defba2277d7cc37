#include "pipeline/batch.h"

namespace voxelpipe {

BatchStats VoxelizeBatch(const Backend& backend, std::span<const BatchItem> items, int threads,
                         const PlanLimits& limits) {
  backend.RunEach(threads, items.size(), [&](size_t i) {
    const BatchItem& item = items[i];
    item.done(VoxelizeInside(backend, *item.mesh, *item.request, *item.job, limits, item.on_plan));
  });
  BatchStats stats;
  stats.passes = uint32_t(items.size());
  return stats;
}

}  // namespace voxelpipe
