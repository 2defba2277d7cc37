#include "jobs/job.h"

#include <algorithm>
#include <exception>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "isolate/loading.h"
#include "load/load_mesh.h"
#include "mesh/mesh_bytes.h"
#include "mesh/parts/part_list.h"
#include "pipeline/estimate.h"

namespace voxelpipe {
namespace {

// Calls `body` and converts exceptions to a status, so that none leaves a worker.
template <typename Result, typename Body>
absl::StatusOr<Result> Guarded(Body body) {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory");
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrCat("unexpected: ", error.what()));
  }
}

// Keeps results that are in memory as a whole and forwards all others.
class KeepOrHandOn final : public ResultSink {
 public:
  KeepOrHandOn(JobOutcome& outcome, ResultSink& large) : outcome_(outcome), large_(large) {}

  bool Keep(VoxelizeResult&& whole) override {
    outcome_.result = std::move(whole);
    return true;
  }
  absl::Status Begin(const ResultHeader& header) override {
    outcome_.streamed = true;
    outcome_.result.grid = header.grid;
    outcome_.result.layout = header.layout;
    outcome_.result.specs = header.specs;
    return large_.Begin(header);
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override { return large_.Write(array, bytes); }

 private:
  JobOutcome& outcome_;
  ResultSink& large_;
};

// Voxelizes into the outcome's result, or into `large` (see RunPrepared).
absl::Status VoxelizeInto(JobOutcome& outcome, const Backend& backend, const TriangleMesh& mesh,
                          const VoxelizeRequest& request, const PlanLimits& limits, const JobContext& job,
                          const PlanHook& on_plan, ResultSink* large) {
  const RunOptions options{.job = job, .limits = limits, .on_plan = on_plan, .backend = &backend};
  if (large == nullptr) {
    absl::StatusOr<VoxelizeResult> result = Voxelize(mesh, request, options);
    if (!result.ok()) return result.status();
    outcome.result = *std::move(result);
    return absl::OkStatus();
  }
  KeepOrHandOn sink(outcome, *large);
  absl::StatusOr<VoxelizeStats> stats = VoxelizeTo(mesh, request, options, sink);
  if (!stats.ok()) return stats.status();
  outcome.result.stats = *std::move(stats);
  return absl::OkStatus();
}

// Adds the warnings and times of the mesh's preparation to an outcome.
void AddMesh(const PreparedMesh& mesh, uint64_t pipeline_bytes, JobOutcome& outcome) {
  outcome.report = mesh.report;
  outcome.examined = mesh.examined;
  outcome.peak_bytes = std::max(mesh.peak_bytes, MeshBytes(*mesh.mesh) + pipeline_bytes);
  auto& stages = outcome.result.stats.stages;
  stages.insert(stages.begin(), mesh.stages.begin(), mesh.stages.end());
}

}  // namespace

absl::StatusOr<std::shared_ptr<const PreparedMesh>> PrepareMesh(std::vector<uint8_t> file, const ParsedConfig& config,
                                                                const JobLimits& limits, const JobContext& job) {
  using Prepared = std::shared_ptr<const PreparedMesh>;
  return Guarded<Prepared>([&]() -> absl::StatusOr<Prepared> {
    absl::StatusOr<LoadedMesh> loaded = LoadMesh(
        std::move(file), {config.mesh_type, TexturesRead(config.request), limits.load}, limits.load_workers, job);
    if (!loaded.ok()) return loaded.status();
    auto prepared = std::make_shared<PreparedMesh>();
    prepared->examined = config.request.fill != Fill::kNone;
    prepared->mesh = std::make_shared<const TriangleMesh>(std::move(loaded->mesh));
    prepared->contents = std::move(loaded->contents);
    prepared->stages = {{"load", loaded->load_ms}, {"flatten", loaded->flatten_ms}};
    prepared->peak_bytes = loaded->peak_bytes;
    if (absl::Status s = LeaveOutParts(config, job, *prepared); !s.ok()) return s;
    if (absl::Status s = SetReport(job, *prepared); !s.ok()) return s;
    return prepared;
  });
}

absl::Status SetReport(const JobContext& job, PreparedMesh& prepared) {
  const absl::StatusOr<MeshReport> report =
      prepared.examined ? ReportMesh(job, *prepared.mesh) : BoxReport(job, *prepared.mesh);
  if (report.ok()) prepared.report = *report;
  return report.status();
}

absl::Status LeaveOutParts(const ParsedConfig& config, const JobContext& job, PreparedMesh& prepared) {
  if (config.request.parts.exclude.empty()) return absl::OkStatus();
  absl::StatusOr<TriangleMesh> kept = ExcludeParts(job, *prepared.mesh, config.request.parts);
  if (!kept.ok()) return kept.status();
  prepared.peak_bytes += kept->memory->bytes();  // both are there for a moment
  prepared.mesh = std::make_shared<const TriangleMesh>(*std::move(kept));
  prepared.memory = MemoryCharge();  // the mesh that it was for is freed
  return absl::OkStatus();
}

absl::StatusOr<JobOutcome> RunPrepared(const Backend& backend, const PreparedMesh& mesh, const ParsedConfig& config,
                                       const JobLimits& limits, const JobContext& job, const PlanHook& on_plan,
                                       ResultSink* large) {
  return Guarded<JobOutcome>([&]() -> absl::StatusOr<JobOutcome> {
    JobOutcome outcome;
    uint64_t pipeline_bytes = 0;
    const auto planned = [&](const Plan& plan) {
      pipeline_bytes = plan.peak_bytes;
      return on_plan ? on_plan(plan) : absl::OkStatus();
    };
    if (absl::Status s = VoxelizeInto(outcome, backend, *mesh.mesh, config.request, limits.plan, job, planned, large);
        !s.ok()) {
      return s;
    }
    AddMesh(mesh, pipeline_bytes, outcome);
    return outcome;
  });
}

JobOutcome OutcomeOf(const PreparedMesh& mesh, VoxelizeResult result, const Plan& plan) {
  JobOutcome outcome;
  outcome.result = std::move(result);
  AddMesh(mesh, plan.peak_bytes, outcome);
  return outcome;
}

absl::StatusOr<Estimate> EstimateJob(const Backend& backend, const PreparedMesh& mesh, const ParsedConfig& config,
                                     const JobLimits& limits, const JobContext& job) {
  return Guarded<Estimate>([&]() -> absl::StatusOr<Estimate> {
    absl::StatusOr<Plan> plan =
        EstimateVoxelization(backend, *mesh.mesh, config.request, job, limits.plan, Delivery::kStream);
    if (!plan.ok()) return plan.status();
    return Estimate{*std::move(plan), mesh.report};
  });
}

}  // namespace voxelpipe
