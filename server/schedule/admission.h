// Admission: decides if one more task may wait.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "absl/status/status.h"
#include "schedule/task.h"

namespace voxelpipe {

struct AdmissionLimits {
  size_t max_jobs = 1024;           // that wait
  uint64_t max_bytes = 2ull << 30;  // that they hold
  double max_ms = 600'000;          // predicted work of all of them, on one worker
};

// What stands before a task.
struct Backlog {
  size_t jobs = 0;  // that wait, for a loader or a worker, and those that are being loaded: they will wait for a worker
  size_t client_jobs = 0;  // of these, the same client's
  uint64_t bytes = 0;      // that these hold
  double ms = 0;           // predicted work of all of them
  double ahead_ms = 0;     // predicted work that is done before it is this task's turn
  size_t running = 0;      // jobs in the hands of workers that run them
  size_t workers = 1;
};

enum class Refused : uint8_t { kNo, kJobs, kBytes, kTime, kDeadline };

struct AdmissionAnswer {
  Refused why = Refused::kNo;
  absl::Status status;
};

// Tasks that may wait: beyond `max_jobs`, those that an idle worker is about to take do not count.
size_t PlacesFor(size_t max_jobs, size_t running, size_t workers);
// The error of every task that comes while the queue is full. RESOURCE_EXHAUSTED (BusyError).
absl::Status QueueFullError(const Backlog& backlog);

// In: what waits, the task's traits and predicted milliseconds, the time. Refuses with a BusyError with the retry delay
//   - beyond a limit; a task that an idle worker is about to take does not count, and where nothing waits any task may;
//   - a client's task where that client has eight ninths of the free places, so that others find one (queues of ten and more);
//   - where half of what is predicted to come before it does not fit before its deadline;
// and with DEADLINE_EXCEEDED where half of its own predicted time does not.
AdmissionAnswer AdmitTask(const AdmissionLimits& limits, const Backlog& backlog, const TaskTraits& traits,
                          double task_ms, JobContext::Clock::time_point now);

}  // namespace voxelpipe
