// Looks at jobs with a deadline, counted by the clock that they read. Linked with
// -Wl,--wrap=_ZNSt6chrono3_V212steady_clock3nowEv, std::chrono::steady_clock::now().
#pragma once

#include <cstdint>

#include "base/job_context.h"

namespace voxelpipe::testing {

// Counts from 0 on, and cancels `job`, which may be null, when look number `look` begins. The job's deadline must be
// far away.
void CountLooks(JobContext* job, uint64_t look);
// Since CountLooks.
uint64_t Looks();

}  // namespace voxelpipe::testing
