#include "pipeline/batch.h"

#include <utility>
#include <vector>

#include "pipeline/warnings.h"

namespace voxelpipe {
namespace {

// The items as a shared pass takes them: it knows nothing of warnings, which are added as it ends. `told` has one for
// each item: whether its hook was called with a plan.
std::vector<BatchItem> ForSharedPass(std::span<const BatchItem> items, std::vector<char>& told) {
  std::vector<BatchItem> out(items.begin(), items.end());
  for (size_t i = 0; i < out.size(); ++i) {
    if (items[i].on_plan) {
      out[i].on_plan = [&item = items[i], &this_one = told[i]](const Plan& plan) {
        this_one = 1;
        return item.on_plan(plan);
      };
    }
    out[i].done = [&item = items[i]](absl::StatusOr<VoxelizeResult> result) {
      if (result.ok()) {
        result->stats.warnings = WarningsOf(*item.mesh, *item.request);
        AddRunWarnings(*item.job, *item.mesh, *item.request, result->stats);
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
  std::vector<char> told(items.size());
  const std::vector<size_t> alone = backend.RunShared(threads, ForSharedPass(items, told), limits, stats);
  stats.sharing = false;
  backend.RunEach(threads, alone.size(), [&](size_t i) {
    const BatchItem& item = items[alone[i]];
    RunOptions options{.job = *item.job, .limits = limits, .backend = &backend, .inside = true};
    if (told[alone[i]] == 0) options.on_plan = item.on_plan;
    item.done(Voxelize(*item.mesh, *item.request, options));
  });
  stats.passes += uint32_t(alone.size());
}

}  // namespace voxelpipe
