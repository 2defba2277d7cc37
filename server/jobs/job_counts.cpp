#include "jobs/job_counts.h"

#include "absl/strings/str_cat.h"

namespace voxelpipe {

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
  if (!LogLine::IsWanted(LogLevel::kInfo)) return {};
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
