// Admission: decides if one more task may wait.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "absl/status/status.h"
#include "schedule/task.h"

namespace voxelpipe {

struct AdmissionLimits {
  size_t max_jobs = 1024;           // waiting jobs
  uint64_t max_bytes = 2ull << 30;  // of the waiting jobs
  double max_ms = 600'000;          // predicted work of all of them, on one worker
};

// The queue before a task.
struct Backlog {
  size_t jobs = 0;         // waiting for a loader or a worker, or being loaded, since they will wait for a worker
  size_t client_jobs = 0;  // of these, those of the same client
  uint64_t bytes = 0;      // of these
  double ms = 0;           // predicted work of all of them
  double ahead_ms = 0;     // predicted work that will be done before this task
  size_t running = 0;      // jobs that workers run
  size_t workers = 1;
};

enum class Refused : uint8_t { kNo, kJobs, kBytes, kTime, kDeadline };

struct AdmissionAnswer {
  Refused why = Refused::kNo;
  absl::Status status;
};

// The number of tasks that may wait: `max_jobs`, plus those that idle workers are about to take.
size_t PlacesFor(size_t max_jobs, size_t running, size_t workers);
// The error of tasks while the queue is full. RESOURCE_EXHAUSTED (BusyError).
absl::Status QueueFullError(const Backlog& backlog);

// In: the backlog, the task's traits and predicted milliseconds, the time. Refuses with a BusyError with a retry delay
//   - beyond a limit; tasks that an idle worker is about to take do not count, and an empty queue admits any task;
//   - a task of a client that has eight ninths of the free places, so that others find one (queues of ten and more);
//   - if half of the work predicted before it does not fit before its deadline;
// and with DEADLINE_EXCEEDED if half of its own predicted time does not fit before its deadline.
AdmissionAnswer AdmitTask(const AdmissionLimits& limits, const Backlog& backlog, const TaskTraits& traits,
                          double task_ms, JobContext::Clock::time_point now);

}  // namespace voxelpipe
