// Repeats calls that a server refused for a while, or that lost their connection.
#pragma once

#include <chrono>
#include <optional>

#include "absl/status/status.h"
#include "base/job_context.h"

namespace voxelpipe {

// In: the error of an attempt, and how many were repeated before it. Out: the time to wait before the next attempt:
// what the server returned (RetryInfo); for UNAVAILABLE without it a random time below 0.1 s * 2^repeated, at most 5 s
// ("full jitter"). None if a repetition cannot help: any other error, or the deadline of the job comes first.
std::optional<std::chrono::milliseconds> DelayBeforeRetry(const absl::Status& error, int repeated,
                                                          const JobContext& job);

// Returns OK after `delay`, or the job's reason to end as soon as it should end.
absl::Status WaitUnlessEnded(std::chrono::milliseconds delay, const JobContext& job);

// Calls attempt(), which returns a StatusOr, until it succeeds, at most 1 + `retries` times and only while may_repeat()
// is true. Out: its last outcome, or the job's reason to end.
template <typename Attempt, typename MayRepeat>
auto CallWithRetries(int retries, const JobContext& job, const Attempt& attempt, const MayRepeat& may_repeat)
    -> decltype(attempt()) {
  for (int repeated = 0;; ++repeated) {
    auto outcome = attempt();
    if (outcome.ok() || repeated >= retries || !may_repeat()) return outcome;
    const std::optional<std::chrono::milliseconds> delay = DelayBeforeRetry(outcome.status(), repeated, job);
    if (!delay) return outcome;
    if (absl::Status ended = WaitUnlessEnded(*delay, job); !ended.ok()) return ended;
  }
}
template <typename Attempt>
auto CallWithRetries(int retries, const JobContext& job, const Attempt& attempt) -> decltype(attempt()) {
  return CallWithRetries(retries, job, attempt, [] { return true; });
}

}  // namespace voxelpipe
