// The working memory of a job, charged to that of all jobs.
#pragma once

#include "absl/status/status.h"
#include "base/job_context.h"
#include "pipeline/plan/plan.h"
#include "schedule/byte_budget.h"

namespace voxelpipe {

// Charges a plan to `working`, the working memory of all jobs. `may_wait` as in VoxelizeJob::Planned. Errors:
// RESOURCE_EXHAUSTED if plan and mesh exceed the memory of all jobs, ABORTED if it would have to wait but may not,
// BusyError after waiting in vain, the job's own.
absl::Status TakeMemory(const Plan& plan, bool may_wait, const JobContext& job, BudgetShare& working);

}  // namespace voxelpipe
