#include "schedule/admission.h"

#include <algorithm>
#include <chrono>
#include <string>

#include "absl/strings/str_cat.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// Bounds of the retry delay: not immediately, and not so long that the server seems unavailable.
constexpr double kShortestRetryMs = 50, kLongestRetryMs = 30'000;
// Predictions are rough: they refuse a task only above twice the available time.
constexpr double kDoubt = 2;
// Limit of one client in the queue, as a multiple of the free places.
constexpr size_t kShareOfFree = 8;

std::string Ms(double ms) {
  return absl::StrCat(int64_t(ms), " ms");
}

absl::Status Busy(const std::string& message, const Backlog& backlog, double ms) {
  const double delay = std::clamp(ms / double(std::max<size_t>(1, backlog.workers)), kShortestRetryMs, kLongestRetryMs);
  return BusyError(message, std::chrono::milliseconds(int64_t(delay)));
}

}  // namespace

size_t PlacesFor(size_t max_jobs, size_t running, size_t workers) {
  return max_jobs + (workers - std::min(workers, running));
}

absl::Status QueueFullError(const Backlog& backlog) {
  // After a tenth of the work there is room again.
  return Busy(absl::StrCat("the queue is full: ", backlog.running, " jobs run and ", backlog.jobs, " wait"), backlog,
              backlog.ms / 10);
}

AdmissionAnswer AdmitTask(const AdmissionLimits& limits, const Backlog& backlog, const TaskTraits& traits,
                          double task_ms, JobContext::Clock::time_point now) {
  const size_t places = PlacesFor(limits.max_jobs, backlog.running, backlog.workers);
  const size_t idle = places - limits.max_jobs;
  const double retry_ms = backlog.ms / 10;  // as in QueueFullError
  if (backlog.jobs >= places) return {Refused::kJobs, QueueFullError(backlog)};
  if (backlog.client_jobs >= kShareOfFree * (places - backlog.jobs)) {
    return {Refused::kJobs,
            Busy(absl::StrCat("this client's share of the queue is full: ", backlog.client_jobs, " of its jobs wait"),
                 backlog, retry_ms)};
  }
  if (backlog.jobs >= idle) {  // it must wait
    if (backlog.bytes > 0 && backlog.bytes + traits.cost.held_bytes > limits.max_bytes) {
      return {Refused::kBytes,
              Busy(absl::StrCat("the queue is full: ", backlog.jobs, " jobs that wait hold ", backlog.bytes, " bytes"),
                   backlog, retry_ms)};
    }
    if (backlog.ms > 0 && backlog.ms + task_ms > limits.max_ms) {
      return {Refused::kTime,
              Busy(absl::StrCat("the queue is full: ", backlog.jobs, " jobs wait for ", Ms(backlog.ms), " of work"),
                   backlog, retry_ms)};
    }
  }
  std::optional<JobContext::Clock::time_point> start_by = traits.deadline;
  if (traits.deadline) {
    const double left_ms = std::chrono::duration<double, std::milli>(*traits.deadline - now).count();
    if (task_ms > kDoubt * std::max(0.0, left_ms)) {
      return {Refused::kDeadline, absl::DeadlineExceededError(absl::StrCat("the job would take ", Ms(task_ms),
                                                                           ", its deadline passes in ", Ms(left_ms)))};
    }
  }
  if (traits.queue_timeout && traits.queue_timeout->count() > 0) {
    const auto by = now + *traits.queue_timeout;
    start_by = start_by ? std::min(*start_by, by) : by;
  }
  if (start_by && backlog.jobs >= idle) {
    const double left_ms = std::chrono::duration<double, std::milli>(*start_by - now).count();
    const double wait_ms = backlog.ahead_ms / double(std::max<size_t>(1, backlog.workers));
    if (wait_ms > kDoubt * std::max(0.0, left_ms)) {
      return {Refused::kDeadline,
              Busy(absl::StrCat("the jobs before this one would take ", Ms(wait_ms), ", it can wait for ", Ms(left_ms)),
                   backlog, backlog.ahead_ms)};
    }
  }
  return {};
}

}  // namespace voxelpipe
