// One run of the pipeline on one backend: what voxelize.cpp, the slab loop and the public functions share.
#pragma once

#include "absl/status/status.h"
#include "base/job_context.h"
#include "job/stats.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/assemble.h"
#include "pipeline/stages/stages.h"
#include "pipeline/voxelize.h"

namespace voxelpipe {

// What a run gets. All of it outlives the run.
struct RunInput {
  const Backend& backend;
  const TriangleMesh& mesh;
  const VoxelizeRequest& request;
  const JobContext& job;
  const PlanLimits& limits;
  Delivery delivery;
  const PlanHook& on_plan;  // may be empty
  bool on_device = false;   // see RunOptions
};

// The whole run, inside the backend's arena; in voxelize.cpp. Slabs go to `assembler`; counts, times and the warnings
// that the mesh and the request give to `stats`.
absl::Status RunPipeline(const RunInput& run, Assembler& assembler, VoxelizeStats& stats);

}  // namespace voxelpipe
