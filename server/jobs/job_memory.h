// The memory that a job works in, taken from that of all jobs.
#pragma once

#include "absl/status/status.h"
#include "base/job_context.h"
#include "pipeline/plan/plan.h"
#include "schedule/byte_budget.h"

namespace voxelpipe {

// Charges a plan to `working`, what all jobs of the server work in. `may_wait` as in VoxelizeJob::Planned.
// Errors: RESOURCE_EXHAUSTED where plan and mesh are more than all jobs may take, ABORTED where it may not wait,
// BusyError where waiting did not help, the job's own.
absl::Status TakeMemory(const Plan& plan, bool may_wait, const JobContext& job, BudgetShare& working);

}  // namespace voxelpipe
