#include "pipeline/batch.h"

#include <vector>

namespace voxelpipe {

BatchStats VoxelizeBatch(const Backend& backend, std::span<const BatchItem> items, int threads,
                         const PlanLimits& limits) {
  BatchStats stats;
  const std::vector<size_t> alone = backend.RunShared(threads, items, limits, stats);
  backend.RunEach(threads, alone.size(), [&](size_t i) {
    const BatchItem& item = items[alone[i]];
    item.done(VoxelizeInside(backend, *item.mesh, *item.request, *item.job, limits, item.on_plan));
  });
  stats.passes += uint32_t(alone.size());
  return stats;
}

}  // namespace voxelpipe
