#include "jobs/job_memory.h"

#include <algorithm>
#include <chrono>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "jobs/request_memory.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

constexpr std::chrono::milliseconds kRetryDelay{1000};

}  // namespace

absl::Status TakeMemory(const Plan& plan, bool may_wait, const JobContext& job, BudgetShare& working) {
  if (job.memory() != nullptr) {
    job.memory()->set_leave(0);  // it runs now and will end soon
    job.memory()->set_wait({});  // a hung device may still allocate after the job has ended
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

}  // namespace voxelpipe
