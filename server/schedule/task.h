// A unit of work of the server: its traits for the scheduler, and the functions for workers. No gRPC.
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

// The predicted cost of a task, before or after its mesh is known. See cost.h.
struct JobCost {
  uint64_t file_bytes = 0;  // of the mesh; 0 after loading, or without a file
  uint64_t held_bytes = 0;  // memory while it waits: the file, or the loaded mesh
  uint64_t triangles = 0, voxels = 0;
  uint64_t output_bytes = 0;       // of the result
  uint64_t device_bytes = 0;       // on a device with memory of its own
  double load_ms = 0, run_ms = 0;  // on one loader, on one worker
};

struct TaskTraits {
  std::string client;  // the client of the caller's token, otherwise the peer's address
  Priority priority = Priority::kNormal;
  JobCost cost;
  JobContext::Clock::time_point arrived = JobContext::Clock::now();  // set again by Submit
  std::optional<JobContext::Clock::time_point> deadline;             // of the call
  std::optional<std::chrono::milliseconds> queue_timeout;            // absent: that of the scheduler
  std::optional<JobContext::Clock::time_point> queue_deadline;  // a worker must take it by then; set by the scheduler
  BackendChoice backend = BackendChoice::kAuto;
  bool fallback = true;  // true if another kind of backend may run it
  std::vector<std::string>
      excluded_devices;  // devices that failed it, by Backend::device(): their workers do not get it again
};

// Between Submit and its end, a task belongs to the scheduler or to one worker. It ends exactly once: by Load returning
// false, by the device worker that finished it, or by Refuse. Withdrawn tasks return to the caller.
class Task {
 public:
  virtual ~Task() = default;

  // False if a loader must process it before a device worker can. Called by the scheduler, also from threads other than
  // the one that works on it, but not concurrently.
  virtual bool loaded() const = 0;
  // Updates traits.cost with the current facts. Called by the code that submits the task.
  virtual void Weigh() {}
  // On a loader's thread. True if a device worker comes next.
  virtual bool Load() = 0;
  // Ends a task that no worker will run: its time in the queue is over, or no device can run it. Called without locks.
  virtual void Refuse(absl::Status why) = 0;

  TaskTraits traits;  // set before Submit; cost also by Load
};

}  // namespace voxelpipe
