// A piece of work on its way through the server: its traits for the scheduler, and what workers call. No gRPC.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "job/request.h"
#include "wire/call_settings.h"

namespace voxelpipe {

inline constexpr size_t kPriorities = 3;

// What a task is thought to take, before its mesh is known or after. See cost.h.
struct JobCost {
  uint64_t file_bytes = 0;  // of the mesh; 0 once it is loaded, or where none comes
  uint64_t held_bytes = 0;  // that it keeps in memory while it waits: the file, or what was made of it
  uint64_t triangles = 0, voxels = 0;
  uint64_t output_bytes = 0;       // of the result
  uint64_t device_bytes = 0;       // on a device with memory of its own
  double load_ms = 0, run_ms = 0;  // on one loader, on one worker
};

struct TaskTraits {
  std::string client;  // the caller: the client of its token, else the peer's address
  Priority priority = Priority::kNormal;
  JobCost cost;
  JobContext::Clock::time_point arrived = JobContext::Clock::now();  // Submit sets it anew
  std::optional<JobContext::Clock::time_point> deadline;             // of the call: an answer after it is worthless
  std::optional<std::chrono::milliseconds> queue_timeout;            // absent: the scheduler's
  std::optional<JobContext::Clock::time_point> queue_deadline;  // a worker must have it by then; the scheduler sets it
  BackendChoice backend = BackendChoice::kAuto;
  bool fallback = true;                       // true if another kind of backend may run it
  std::vector<std::string> excluded_devices;  // that failed it, by Backend::device(): no worker of these gets it again
};

// Between Submit and the end of its work, a task belongs to the scheduler or to one worker. Either ends it exactly
// once: by Load that returns false, by the device worker that finished it, or by Refuse. Withdrawn tasks are the
// caller's again.
class Task {
 public:
  virtual ~Task() = default;

  // False where a loader must have it before a device worker can. Asked by the scheduler, also from other threads than
  // the one that works on it, but not while it does.
  virtual bool loaded() const = 0;
  // Brings traits.cost up to date with what is known now. Called by the code that submits the task.
  virtual void Weigh() {}
  // On a loader's thread. True where a device worker comes next.
  virtual bool Load() = 0;
  // Ends a task that no worker will have: its time in the queue is over, or nothing here can run it. Called without
  // locks.
  virtual void Refuse(absl::Status why) = 0;

  TaskTraits traits;  // set before Submit; cost also by Load
};

}  // namespace voxelpipe
