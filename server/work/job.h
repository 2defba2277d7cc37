// What a worker does for one request, without any gRPC.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/limits.h"
#include "mesh/report.h"
#include "pipeline/plan.h"
#include "pipeline/voxelize.h"
#include "wire/request.h"

namespace voxelpipe {

struct JobLimits {
  LoadLimits load;
  PlanLimits plan;
};

struct JobOutcome {
  VoxelizeResult result;  // stats.stages begin with load and flatten; no arrays where they were streamed
  bool streamed = false;  // the arrays went to the sink
  MeshReport report;
  bool examined = false;              // degenerate triangles and open edges were counted
  std::vector<std::string> warnings;  // of the loader
  uint64_t peak_bytes = 0;  // estimate of this request's peak: the largest of loading, flattening and the pipeline
};

// In: a mesh file and a config. Out: its voxels. The file is freed as soon as it is loaded, the scene as soon as it is flat.
// `on_plan` is called once, before rasterization.
// A dense result that takes more than one slab of limits.plan.slab_bytes goes to `large` slab after slab; all others, and all
// where `large` is null, are in the outcome.
// Errors: those of LoadScene, Flatten, PrepareTextures, Voxelize and the sink; RESOURCE_EXHAUSTED out of memory. Never throws.
absl::StatusOr<JobOutcome> RunJob(std::vector<uint8_t> file, const ParsedConfig& config, const JobLimits& limits,
                                  const JobContext& job, const std::function<void(const Plan&)>& on_plan,
                                  ResultSink* large = nullptr);

struct Estimate {
  Plan plan;
  MeshReport report;
};

// In: a mesh file and a config. Out: the plan of RunJob with a sink, without rasterizing. Errors as for RunJob.
absl::StatusOr<Estimate> EstimateJob(std::vector<uint8_t> file, const ParsedConfig& config, const JobLimits& limits,
                                     const JobContext& job);

}  // namespace voxelpipe
