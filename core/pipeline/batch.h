// Many meshes at once: what a server does with small jobs that wait at the same time.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/plan.h"
#include "pipeline/request.h"
#include "pipeline/result.h"
#include "pipeline/stages.h"

namespace voxelpipe {

// One job of a batch. Everything pointed to must outlive the call.
struct BatchItem {
  const TriangleMesh* mesh = nullptr;  // as for Voxelize
  const VoxelizeRequest* request = nullptr;
  const JobContext* job = nullptr;
  std::function<void(const Plan&)> on_plan;  // as for Voxelize; from any thread, not concurrently for one item
};

struct BatchStats {
  uint32_t passes = 0;               // times that the device's stages ran: 1 where all items shared one
  std::optional<uint64_t> launches;  // kernel launches of all passes together; CUDA only
};

// Out: one result or error an item, in their order: the same bytes as Voxelize of each alone. An item's error, cancellation or
// deadline is its own. `threads` is that of the whole batch (0 = all); the items' own are not looked at.
std::vector<absl::StatusOr<VoxelizeResult>> VoxelizeBatch(const Backend& backend, std::span<const BatchItem> items,
                                                          int threads, const PlanLimits& limits = {},
                                                          BatchStats* stats = nullptr);

}  // namespace voxelpipe
