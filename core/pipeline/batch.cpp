#include "pipeline/batch.h"

#include <utility>
#include <vector>

#include "pipeline/warnings.h"

namespace voxelpipe {
namespace {

// The items as a shared pass takes them: it knows nothing of warnings, which are added as it ends.
std::vector<BatchItem> WithWarnings(std::span<const BatchItem> items) {
  std::vector<BatchItem> out(items.begin(), items.end());
  for (size_t i = 0; i < out.size(); ++i) {
    out[i].done = [&item = items[i]](absl::StatusOr<VoxelizeResult> result) {
      if (result.ok()) {
        result->stats.warnings = WarningsOf(*item.mesh, *item.request);
        AddRunWarnings(*item.mesh, *item.request, result->stats);
        if (absl::Status s = CheckStrict(*item.request, result->stats.warnings); !s.ok()) result = s;
      }
      item.done(std::move(result));
    };
  }
  return out;
}

}  // namespace

BatchStats VoxelizeBatch(const Backend& backend, std::span<const BatchItem> items, int threads,
                         const PlanLimits& limits) {
  BatchStats stats;
  VoxelizeBatch(backend, items, threads, limits, stats);
  return stats;
}

void VoxelizeBatch(const Backend& backend, std::span<const BatchItem> items, int threads, const PlanLimits& limits,
                   BatchStats& stats) {
  stats.sharing = true;
  const std::vector<size_t> alone = backend.RunShared(threads, WithWarnings(items), limits, stats);
  stats.sharing = false;
  backend.RunEach(threads, alone.size(), [&](size_t i) {
    const BatchItem& item = items[alone[i]];
    const RunOptions options{
        .job = *item.job, .limits = limits, .on_plan = item.on_plan, .backend = &backend, .inside = true};
    item.done(Voxelize(*item.mesh, *item.request, options));
  });
  stats.passes += uint32_t(alone.size());
}

}  // namespace voxelpipe
