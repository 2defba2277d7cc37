#include "retry.h"

#include <algorithm>
#include <random>
#include <thread>

#include "client.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kFirstDelay{100}, kMaxDelay{5000};
constexpr milliseconds kMaxRestartDelay{1000};  // between attempts to connect to a server that restarts
constexpr milliseconds kPoll{10};               // between two looks at the job

milliseconds RandomBelow(milliseconds limit) {
  thread_local std::minstd_rand random{std::random_device{}()};
  return milliseconds(std::uniform_int_distribution<int64_t>(0, limit.count())(random));
}

}  // namespace

bool CountsAsAttempt(const absl::Status& error, const JobContext& job) {
  return !IsConnectError(error) || !job.deadline();
}

std::optional<milliseconds> DelayBeforeRetry(const absl::Status& error, int repeated, const JobContext& job) {
  if (!job.Check().ok()) return std::nullopt;
  std::optional<milliseconds> delay;
  if (absl::IsUnavailable(error) || absl::IsResourceExhausted(error)) delay = RetryDelay(error);
  if (!delay && absl::IsUnavailable(error)) {
    const milliseconds most = CountsAsAttempt(error, job) ? kMaxDelay : kMaxRestartDelay;
    delay = RandomBelow(std::min(most, kFirstDelay * (int64_t{1} << std::clamp(repeated, 0, 10))));
  }
  if (delay && job.deadline() && JobContext::Clock::now() + *delay >= *job.deadline()) return std::nullopt;
  return delay;
}

absl::Status WaitUnlessEnded(milliseconds delay, const JobContext& job) {
  const JobContext::Clock::time_point end = JobContext::Clock::now() + delay;
  for (;;) {
    if (absl::Status status = job.Check(); !status.ok()) return status;
    const JobContext::Clock::time_point now = JobContext::Clock::now();
    if (now >= end) return absl::OkStatus();
    std::this_thread::sleep_for(std::min<JobContext::Clock::duration>(kPoll, end - now));
  }
}

}  // namespace voxelpipe
