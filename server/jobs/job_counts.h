// What metrics and the access log say of a job that has ended.
#pragma once

#include "absl/status/statusor.h"
#include "jobs/voxelize_job.h"
#include "observe/log.h"
#include "observe/metrics.h"

namespace voxelpipe {

// A job has ended: counts it, and what its stages took.
void CountJob(Metrics& metrics, const absl::StatusOr<JobOutcome>& outcome);
// Of these, the times that the work took: once a run, however many jobs it served.
void CountWork(Metrics& metrics, const JobOutcome& outcome);

// The fields of a job in the access log.
LogFields Facts(const JobOutcome& outcome);

}  // namespace voxelpipe
