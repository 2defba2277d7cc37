// The worker threads: loaders, and the workers of each device.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "pipeline/stages/stages.h"
#include "run/device_health.h"
#include "run/device_run.h"
#include "schedule/scheduler.h"

namespace voxelpipe {

class Metrics;

struct DeviceWorkers {
  const Backend* backend = nullptr;  // see Devices() in pipeline/stages/backend.h
  int workers = 1;                   // batches that run on it at the same time
};

struct WorkerPoolOptions {
  int loaders = 1;  // meshes that are loaded at the same time, besides small ones that workers load themselves
  std::vector<DeviceWorkers> devices;
  int threads = 0;            // of one batch on the CPU; 0 = all
  uint32_t max_attempts = 3;  // workers that try a job before it fails with the device failure
  DeviceHealthOptions health = {};
  // A GPU without progress for this time, and for ten times the predicted time of its batch, is considered lost; 0 =
  // never.
  std::chrono::milliseconds stall{30'000};
  Metrics* metrics = nullptr;  // must outlive the pool
  // Why there is no GPU, for clients that ask for one; empty: the operator chose none.
  std::string why_no_gpu = {};
  int spare_loaders = 0;  // extra threads for clients that would wait for loads of others (Scheduler::TakeLoad)
};

// The state of a device in the pool.
struct DeviceReport {
  const Backend* backend = nullptr;
  int workers = 0;
  bool serving = true;
  std::string reason;  // why it does not serve
};

// Takes tasks from a scheduler until it is stopped. A job whose device fails is run again elsewhere
// (schedule/device_choice.h); a failing device is quarantined (run/device_health.h) and probed by its own workers,
// which are idle then. If a device hangs, its thread is abandoned, and its jobs and its slot move to others. An
// abandoned thread accesses nothing of the pool any more; it ends if the device ever returns, otherwise with the
// process (ThreadsLeftBehind).
class WorkerPool {
 public:
  // `scheduler` must outlive the pool.
  WorkerPool(Scheduler& scheduler, const WorkerPoolOptions& options, const PlanLimits& limits);
  // Drains and stops the scheduler, and ends the threads.
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  // OK if a serving device may run such a task. FAILED_PRECONDITION if the server has none of that kind; UNAVAILABLE
  // with the time to the next probe if none serves now.
  absl::Status CheckServed(const TaskTraits& task) const;

  // The best device that serves and may run such a task. Errors: those of CheckServed.
  absl::StatusOr<const Backend*> FindDevice(const TaskTraits& task) const;

  // Best first.
  std::vector<DeviceReport> Devices() const;
  // Of the first of its devices.
  BackendChoice best_kind() const;
  // Calls `listener` for every device now and at every change, one call at a time, from any thread, until another
  // listener replaces it. It must not call the pool.
  void SetListener(std::function<void(const std::string& device, bool serving)> listener);

  // Sets how many meshes are loaded, and how many batches run on the CPU, at the same time. Running ones continue.
  void Resize(int loaders, int cpu_workers);

  // Shortens the time in which a device must react to cancelled jobs, because the process ends.
  void Hasten();

  // The number of abandoned threads of all pools of this process that have not ended. While there are any, static
  // objects must not be destroyed: use _exit.
  static size_t ThreadsLeftBehind();

 private:
  struct Device;
  struct Worker;
  using Clock = DeviceRun::Clock;

  void LoadTasks();
  void StartLoaders(int count);
  // With the device's lock.
  void StartWorker(const std::shared_ptr<Device>& device);
  // A worker's thread. Accesses the pool only while the worker is not abandoned.
  static void Work(WorkerPool* pool, std::shared_ptr<Worker> self);
  // False if the worker was abandoned meanwhile.
  bool RunBatch(Worker& self, std::vector<std::shared_ptr<Task>> batch);
  // False if the worker must end.
  bool WaitUntilServing(Worker& self);
  // False if the worker was abandoned meanwhile. With the device's lock, which is released during the probe.
  bool Probe(Worker& self, std::unique_lock<std::mutex>& lock, absl::Status& outcome);
  // Finishes, retries or ends the tasks of a run. True if a single one did not fit into the device's memory.
  bool Settle(Device& device, const DeviceRun& run);
  // Resubmits a task whose device failed, or ends it.
  void FailOver(const Device& device, std::shared_ptr<Task> task, const absl::Status& failure);
  // The device failed; if it stops serving, notifies scheduler and listener.
  void Failed(Device& device, DeviceFailureKind kind, const std::string& reason);
  void Changed(Device& device);
  void RefuseStranded();

  // The watch: one thread that monitors those of the GPUs.
  void Watch();
  void WakeWatch();
  bool LookAround();
  std::chrono::milliseconds PatienceWith(const DeviceRun& run) const;

  static std::atomic<size_t> left_behind_;  // see ThreadsLeftBehind

  Scheduler& scheduler_;
  const WorkerPoolOptions options_;
  const PlanLimits limits_;
  std::vector<std::shared_ptr<Device>> devices_;
  std::mutex resize_mutex_;
  std::vector<std::thread> loaders_;         // with its lock, until the pool ends
  std::atomic<int> cpu_runs_{0}, loads_{0};  // currently running

  std::mutex change_mutex_;  // one change at a time; taken before a device's lock
  std::function<void(const std::string&, bool)> listener_;

  mutable std::mutex watch_mutex_;
  std::condition_variable watch_changed_;
  bool watch_woken_ = false, watch_idle_ = false, stopping_ = false, hasty_ = false;
  std::thread watch_;
};

}  // namespace voxelpipe
