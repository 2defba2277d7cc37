// The work for one request, without gRPC and without a queue.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/contents.h"
#include "mesh/report.h"
#include "mesh/scene/load_limits.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/plan/plan.h"
#include "pipeline/voxelize.h"
#include "wire/request.h"

namespace voxelpipe {

class LoadWorkers;
class ResultSums;

struct JobLimits {
  LoadLimits load;
  PlanLimits plan;
  LoadWorkers* load_workers =
      nullptr;  // for files that need third-party decoders (isolate/loading.h); null: this process
};

// A mesh ready for the pipeline, with the textures that the request reads decoded.
struct PreparedMesh {
  std::shared_ptr<const TriangleMesh> mesh;            // never null; other jobs may share it
  MeshContents contents;                               // of the file; empty for a stored mesh
  std::vector<std::pair<std::string, double>> stages;  // of the preparation: "load", "flatten", wall milliseconds
  uint64_t peak_bytes = 0;                             // of the preparation, computed from sizes
  MeshReport report;
  bool examined = false;  // degenerate triangles and open edges were counted
  MemoryCharge memory;    // charge of the mesh to the request's budget, if the mesh does not hold it itself
};

struct JobOutcome {
  VoxelizeResult result;  // stats.stages begin with those of the mesh; no arrays if they were streamed
  bool streamed = false;  // the arrays went to the sink
  MeshReport report;
  bool examined = false;             // see PreparedMesh
  std::shared_ptr<ResultSums> sums;  // if several calls read the result; null: one does
  uint64_t peak_bytes = 0;  // estimate of this request's peak: the largest of loading, flattening and the pipeline
  // Its execution.
  std::string worker;  // "cpu/0"
  double queue_ms = 0;
  uint32_t batch_jobs = 1;
  std::optional<uint64_t> batch_launches;
  uint32_t attempts = 1;
};

// In: a mesh file and a config. Out: its mesh, without the parts that the request excludes. The file is freed after
// loading, the scene after flattening. Errors: those of LoadScene, Flatten, PrepareTextures and ExcludeParts;
// RESOURCE_EXHAUSTED out of memory. Never throws.
absl::StatusOr<std::shared_ptr<const PreparedMesh>> PrepareMesh(std::vector<uint8_t> file, const ParsedConfig& config,
                                                                const JobLimits& limits, const JobContext& job);

// Sets the report of a mesh that this job alone has. Errors: those of ReportMesh.
absl::Status SetReport(const JobContext& job, PreparedMesh& prepared);

// Leaves out the parts that the request excludes. The mesh is then this job's own, charged to it. Without such parts
// nothing changes. To be called before the mesh is reported. Errors: those of ExcludeParts.
absl::Status LeaveOutParts(const ParsedConfig& config, const JobContext& job, PreparedMesh& prepared);

// In: a prepared mesh and a config. Out: its voxels, made on `backend`. A dense result of more than one slab of
// limits.plan.slab_bytes is streamed to `large` slab by slab; all others, and all if `large` is null, are in the
// outcome. Errors: those of VoxelizeTo and the sink; RESOURCE_EXHAUSTED out of memory. Never throws.
absl::StatusOr<JobOutcome> RunPrepared(const Backend& backend, const PreparedMesh& mesh, const ParsedConfig& config,
                                       const JobLimits& limits, const JobContext& job, const PlanHook& on_plan,
                                       ResultSink* large = nullptr);

// The outcome of a result of a batch; `plan` is that of its run.
JobOutcome OutcomeOf(const PreparedMesh& mesh, VoxelizeResult result, const Plan& plan);

struct Estimate {
  Plan plan;
  MeshReport report;
};

// In: a prepared mesh and a config. Out: the plan of RunPrepared on `backend` with a sink, without rasterizing. Errors
// as for RunPrepared.
absl::StatusOr<Estimate> EstimateJob(const Backend& backend, const PreparedMesh& mesh, const ParsedConfig& config,
                                     const JobLimits& limits, const JobContext& job);

}  // namespace voxelpipe
