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
  VoxelizeResult result;  // stats.stages begin with load and flatten
  MeshReport report;
  bool examined = false;              // degenerate triangles and open edges were counted
  std::vector<std::string> warnings;  // of the loader
  uint64_t peak_bytes = 0;  // estimate of this request's peak: the largest of loading, flattening and the pipeline
};

// In: a mesh file and a config. Out: its voxels. The file is freed as soon as it is loaded, the scene as soon as it is flat.
// `on_plan` is called once, before rasterization.
// Errors: those of LoadScene, Flatten, PrepareTextures and Voxelize; RESOURCE_EXHAUSTED out of memory. Never throws.
absl::StatusOr<JobOutcome> RunJob(std::vector<uint8_t> file, const ParsedConfig& config, const JobLimits& limits,
                                  const JobContext& job, const std::function<void(const Plan&)>& on_plan);

struct Estimate {
  Plan plan;
  MeshReport report;
};

// In: a mesh file and a config. Out: the plan of RunJob, without rasterizing. Errors as for RunJob.
absl::StatusOr<Estimate> EstimateJob(std::vector<uint8_t> file, const ParsedConfig& config, const JobLimits& limits,
                                     const JobContext& job);

}  // namespace voxelpipe
