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

// True if an attempt that failed with `error` counts. A client has been connected once: if it cannot connect, its
// server restarts, and a job with a deadline waits for it until its deadline.
bool CountsAsAttempt(const absl::Status& error, const JobContext& job);

// Calls attempt(), which returns a StatusOr, until it succeeds, at most 1 + `retries` times that count and only while
// may_repeat() is true; once if `retries` is 0. Out: its last outcome, or the job's reason to end.
template <typename Attempt, typename MayRepeat>
auto CallWithRetries(int retries, const JobContext& job, const Attempt& attempt, const MayRepeat& may_repeat)
    -> decltype(attempt()) {
  int counted = 0;
  for (int repeated = 0;; ++repeated) {
    auto outcome = attempt();
    if (outcome.ok() || retries <= 0 || !may_repeat()) return outcome;
    if (CountsAsAttempt(outcome.status(), job) && counted++ >= retries) return outcome;
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
