#include "calls/job_setup.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "calls/call_setup.h"
#include "wire/status.h"
#include "work/request_memory.h"

namespace voxelpipe {
namespace {

constexpr std::chrono::milliseconds kRetryDelay{1000};

absl::Status FindKeptMesh(ServiceState& state, VoxelizeJob& job) {
  if (job.config.mesh_id.empty()) return absl::OkStatus();
  if (absl::Status s = CheckMeshId(job.config.mesh_id, "mesh_id"); !s.ok()) return s;
  absl::StatusOr<std::shared_ptr<KeptMesh>> mesh = state.meshes.Take(job.config.mesh_id);
  if (!mesh.ok()) return mesh.status();
  job.store = &state.meshes;
  job.kept = *std::move(mesh);
  return absl::OkStatus();
}

}  // namespace

absl::Status ConfigureJob(ServiceState& state, const v1::VoxelizeConfig& message, const std::string& client,
                          VoxelizeJob& job) {
  absl::StatusOr<ParsedConfig> parsed = ParseConfig(message);
  if (!parsed.ok()) return parsed.status();
  job.config = *std::move(parsed);
  const CallSettings& settings = job.config.settings;
  job.limits = &state.limits;
  job.memory = MakeRequestMemory(state.working, job.context);
  job.traits.client = client;
  job.traits.deadline = job.context.deadline();
  // The server's choice is not the client's: another kind of worker may do it then.
  const BackendChoice asked = job.config.request.backend;
  if (absl::Status s = PrepareRequest(state, job.config.request); !s.ok()) return s;
  job.traits.backend = job.config.request.backend;
  job.traits.fallback = state.options.fallback && settings.fallback.value_or(asked == BackendChoice::kAuto);
  // Without a fallback the job stays on one kind, the best.
  if (job.traits.backend == BackendChoice::kAuto && !job.traits.fallback) job.traits.backend = state.pool.best_kind();
  if (absl::Status s = state.pool.CheckServed(job.traits); !s.ok()) return s;
  job.traits.priority = settings.priority;
  job.traits.queue_timeout = settings.queue_timeout;
  if (absl::Status s = FindKeptMesh(state, job); !s.ok()) return s;
  job.Weigh();
  return absl::OkStatus();
}

absl::Status TakeMemory(const Plan& plan, bool may_wait, const JobContext& job, BudgetShare& working) {
  if (job.memory() != nullptr) {
    job.memory()->set_leave(0);  // it runs now, and ends soon
    job.memory()->set_wait({});  // a device that does not answer may still take when the job is gone
  }
  const uint64_t held = job.memory() == nullptr ? 0 : job.memory()->used_bytes();  // the mesh
  const uint64_t limit = working.budget().limit();
  if (plan.peak_bytes > limit - std::min(limit, held)) {
    return MakeLimitError(absl::StrCat("the job needs ", plan.peak_bytes, " bytes of memory beside the ", held,
                                       " of its mesh; the limit is ", limit, " bytes"),
                          {plan.peak_bytes + held, limit, 0});
  }
  if (!may_wait) {
    if (!working.TryGrow(plan.peak_bytes)) return absl::AbortedError("the memory that this job needs is in use");
    return absl::OkStatus();
  }
  if (working.Grow(plan.peak_bytes, job, kMemoryPatience, held)) return absl::OkStatus();
  if (absl::Status s = job.Check(); !s.ok()) return s;
  return BusyError("the memory that this job needs is in use by others", kRetryDelay);
}

PieceOptions PiecesOf(const ServerOptions& options) {
  return {.piece_bytes = options.piece_bytes, .zstd_level = options.zstd_level};
}

void CountJob(Metrics& metrics, const absl::StatusOr<JobOutcome>& outcome) {
  metrics.JobEnded(outcome.status().code());
  if (outcome.ok()) CountWork(metrics, *outcome);
}

void CountWork(Metrics& metrics, const JobOutcome& outcome) {
  const VoxelizeStats& stats = outcome.result.stats;
  double ms = stats.voxelize_ms;
  for (const auto& [stage, stage_ms] : stats.stages) {
    metrics.Stage(stage).Observe(stage_ms * 1e-3);
    if (stage == "load" || stage == "flatten") ms += stage_ms;
  }
  metrics.job_seconds.Observe(ms * 1e-3);
}

LogFields Facts(const JobOutcome& outcome) {
  if (!LogLine::IsWanted(spdlog::level::info)) return {};
  const GridSpec& grid = outcome.result.grid;
  const VoxelizeStats& stats = outcome.result.stats;
  LogFields facts = {{"worker", outcome.worker},
                     {"queue_ms", outcome.queue_ms},
                     {"batch", uint64_t{outcome.batch_jobs}},
                     {"triangles", stats.triangles},
                     {"dims", absl::StrCat(grid.dims[0], "x", grid.dims[1], "x", grid.dims[2])},
                     {"occupied", stats.occupied},
                     {"voxelize_ms", stats.voxelize_ms},
                     {"peak", outcome.peak_bytes}};
  if (outcome.attempts > 1) facts.push_back({"attempts", uint64_t{outcome.attempts}});
  return facts;
}

}  // namespace voxelpipe
