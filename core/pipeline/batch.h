// Many meshes at once: what a server does with small jobs that wait at the same time.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "job/request.h"
#include "job/result.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/plan/plan.h"
#include "pipeline/stages/stages.h"
#include "pipeline/voxelize.h"

namespace voxelpipe {

// One job of a batch. Everything pointed to must outlive the call.
struct BatchItem {
  const TriangleMesh* mesh = nullptr;  // as for Voxelize
  const VoxelizeRequest* request = nullptr;
  const JobContext* job = nullptr;
  PlanHook on_plan;  // as in RunOptions
  // Called once, from any thread, as soon as the result or error is there, which may be long before the batch's end.
  // Items may be done at the same time.
  std::function<void(absl::StatusOr<VoxelizeResult>)> done;
};

struct BatchStats {
  uint32_t passes = 0;               // times that the device's stages ran: 1 where all items shared one
  uint32_t shared = 0;               // items that ran together with others in a pass
  std::optional<uint64_t> launches;  // kernel launches of the shared passes; CUDA only
  bool sharing = false;              // while shared passes run: an item that is done now was in one
};

// Gives each item its result or error: the same bytes as Voxelize of each alone. Returns when all are done. An item's
// error, cancellation or deadline is its own. An item that shared a pass has the pass's time as its own. `threads` is
// that of the whole batch (0 = all); the items' own are not looked at.
BatchStats VoxelizeBatch(const Backend& backend, std::span<const BatchItem> items, int threads,
                         const PlanLimits& limits = {});
// The same; `stats` may be read by an item's `done`.
void VoxelizeBatch(const Backend& backend, std::span<const BatchItem> items, int threads, const PlanLimits& limits,
                   BatchStats& stats);

}  // namespace voxelpipe
