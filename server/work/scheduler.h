// Which task runs next, and which ones together.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "work/device_choice.h"
#include "work/task.h"

namespace voxelpipe {

struct SchedulerOptions {
  size_t max_queue = 1024;    // tasks that wait
  size_t max_batch_jobs = 1;  // tasks given to a device worker at once
};

// Tasks from their submission to the end of their work. Thread-safe.
class Scheduler {
 public:
  // `workers`: tasks that are worked on at the same time, loaders not counted.
  Scheduler(const SchedulerOptions& options, size_t workers);
  ~Scheduler();
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  // Takes a task in. Errors: a BusyError when too much waits; UNAVAILABLE after Drain began.
  absl::Status Submit(std::shared_ptr<Task> task);
  // Gives back a task that came from Take..., to be taken again: loaded meanwhile, or because its worker failed. Never refused.
  void Resubmit(std::shared_ptr<Task> task);
  // Takes a task that still waits out: true if it was there, and then nothing of it is called any more.
  bool Withdraw(const Task& task);

  // For loaders: a task that is not loaded. Blocks; null when the scheduler was stopped.
  std::shared_ptr<Task> TakeLoad();
  // For device workers: tasks to run together, at least one, all loaded. Blocks; empty when the scheduler was stopped, or while the
  // device does not serve.
  std::vector<std::shared_ptr<Task>> TakeBatch(const WorkerTraits& worker);
  // A task that came from Take... has ended.
  void Ended(const Task& task);

  // Which devices serve: before their first TakeBatch, and at every change. `workers` 0: it takes nothing until it is said otherwise.
  void SetDevice(const WorkerTraits& device, size_t workers);
  // Takes out all tasks that wait and that no device may have that serves now. They are the caller's, and not worked on.
  std::vector<std::shared_ptr<Task>> TakeStranded();
  // Whether a device serves that may have such a task.
  bool IsServed(const TaskTraits& task) const;

  // Refuses new tasks and returns when all accepted ones have ended.
  void Drain();
  // Makes every Take... return nothing. After Drain.
  void Stop();

  size_t queued() const;
  size_t running() const;

 private:
  bool Serves(const std::string& device) const;  // with mutex_ held

  const SchedulerOptions options_;
  const size_t workers_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::shared_ptr<Task>> to_load_, to_run_;
  std::vector<ServingDevice> serving_;
  size_t running_ = 0;  // taken and not ended
  bool draining_ = false, stopped_ = false;
};

}  // namespace voxelpipe
