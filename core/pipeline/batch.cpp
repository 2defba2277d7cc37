#include "pipeline/batch.h"

#include <vector>

namespace voxelpipe {

BatchStats VoxelizeBatch(const Backend& backend, std::span<const BatchItem> items, int threads,
                         const PlanLimits& limits) {
  BatchStats stats;
  VoxelizeBatch(backend, items, threads, limits, stats);
  return stats;
}

void VoxelizeBatch(const Backend& backend, std::span<const BatchItem> items, int threads, const PlanLimits& limits,
                   BatchStats& stats) {
  stats.sharing = true;
  const std::vector<size_t> alone = backend.RunShared(threads, items, limits, stats);
  stats.sharing = false;
  backend.RunEach(threads, alone.size(), [&](size_t i) {
    const BatchItem& item = items[alone[i]];
    item.done(VoxelizeInside(backend, *item.mesh, *item.request, *item.job, limits, item.on_plan));
  });
  stats.passes += uint32_t(alone.size());
}

}  // namespace voxelpipe
