// The metrics and log fields of a job that has ended.
#pragma once

#include "absl/status/statusor.h"
#include "jobs/voxelize_job.h"
#include "observe/log.h"
#include "observe/metrics.h"

namespace voxelpipe {

// Counts a job that has ended, and the times of its stages.
void CountJob(Metrics& metrics, const absl::StatusOr<JobOutcome>& outcome);
// The times of the stages alone: once a run, for all jobs that it served.
void CountWork(Metrics& metrics, const JobOutcome& outcome);

// The fields of a job in the access log.
LogFields Facts(const JobOutcome& outcome);

}  // namespace voxelpipe
