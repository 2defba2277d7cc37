// From a config message to a job that can be submitted: the same for single calls and for many on one stream.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "calls/result_pieces.h"
#include "observe/log.h"
#include "service_state.h"
#include "work/voxelize_job.h"

namespace voxelpipe {

// Fills the job's config, limits and traits from the message; `client` is whom the queue takes it to be from. The job's
// deadline, if any, is set before. Where the config names a mesh that the server keeps, the job gets that mesh, for its
// use to be counted.
// Errors: those of ParseConfig, PrepareRequest and WorkerPool::CheckServed; NOT_FOUND (MissingMeshError).
absl::Status ConfigureJob(ServiceState& state, const v1::VoxelizeConfig& message, const std::string& client,
                          VoxelizeJob& job);

// Charges a plan to `working`, what all jobs of the server work in. `may_wait` as in VoxelizeJob::Planned.
// Errors: RESOURCE_EXHAUSTED where plan and mesh are more than all jobs may take, ABORTED where it may not wait,
// BusyError where waiting did not help, the job's own.
absl::Status TakeMemory(const Plan& plan, bool may_wait, const JobContext& job, BudgetShare& working);

// How the operator wants results cut.
PieceOptions PiecesOf(const ServerOptions& options);

// A job has ended: counts it, and what its stages took.
void CountJob(Metrics& metrics, const absl::StatusOr<JobOutcome>& outcome);
// Of these, the times that the work took: once a run, however many jobs it served.
void CountWork(Metrics& metrics, const JobOutcome& outcome);

// The fields of a job in the access log.
LogFields Facts(const JobOutcome& outcome);

}  // namespace voxelpipe
