// The threads that work: loaders, and the workers of each device.
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
  uint32_t max_attempts = 3;  // workers that are given a job before its device failure is its answer
  DeviceHealthOptions health = {};
  // A GPU that gives no sign of life for so long, and ten times the predicted time of its batch, is taken for lost; 0 =
  // never.
  std::chrono::milliseconds stall{30'000};
  Metrics* metrics = nullptr;  // must outlive the pool
  int spare_loaders = 0;       // threads for clients that would have to wait for those of others (Scheduler::TakeLoad)
};

// A device as the pool sees it.
struct DeviceReport {
  const Backend* backend = nullptr;
  int workers = 0;
  bool serving = true;
  std::string reason;  // why it does not
};

// Takes tasks from a scheduler until it is stopped. A job whose device fails is run again elsewhere
// (schedule/device_choice.h says where); a device that fails is quarantined (run/device_health.h) and probed by its own
// workers, which have nothing else to do then. A device that never answers keeps its thread: that is left behind, its
// jobs and its place go to others. A thread left behind touches nothing of the pool any more; it ends by itself if the
// device ever answers, and otherwise with the process (ThreadsLeftBehind).
class WorkerPool {
 public:
  // `scheduler` must outlive the pool.
  WorkerPool(Scheduler& scheduler, const WorkerPoolOptions& options, const PlanLimits& limits);
  // Drains and stops the scheduler, and ends the threads.
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  // OK where a device serves that may have such a task. FAILED_PRECONDITION where the server has none of that kind;
  // UNAVAILABLE with the time to the next probe where none serves now.
  absl::Status CheckServed(const TaskTraits& task) const;

  std::vector<DeviceReport> Devices() const;
  // Of the first of its devices.
  BackendChoice best_kind() const;
  // `listener` is called for every device now, and for every change, one call at a time, from any thread, until another
  // one takes its place. It must not call back here.
  void SetListener(std::function<void(const std::string& device, bool serving)> listener);

  // How many meshes are loaded, and how many batches run on the CPU at the same time, from now on. What is under way
  // goes on.
  void Resize(int loaders, int cpu_workers);

  // From now on a device has only a moment to react to cancelled jobs: the process wants to end.
  void Hasten();

  // Of all pools of this process, those that have not ended. While there are any, static objects must not be destroyed:
  // _exit.
  static size_t ThreadsLeftBehind();

 private:
  struct Device;
  struct Worker;
  using Clock = DeviceRun::Clock;

  void LoadTasks();
  void StartLoaders(int count);
  // With the device's lock.
  void StartWorker(const std::shared_ptr<Device>& device);
  // A worker's thread. Touches the pool only while the worker was not left behind.
  static void Work(WorkerPool* pool, std::shared_ptr<Worker> self);
  // False where the worker was left behind meanwhile.
  bool RunBatch(Worker& self, std::vector<std::shared_ptr<Task>> batch);
  // False when the worker is to end.
  bool WaitUntilServing(Worker& self);
  // False where the worker was left behind meanwhile. With the device's lock, which is given up for the probe.
  bool Probe(Worker& self, std::unique_lock<std::mutex>& lock, absl::Status& outcome);
  // Does with the tasks of a run what there is to do. True where one alone did not fit into the device's memory.
  bool Settle(Device& device, const DeviceRun& run);
  // Finds another place for a task that its device failed, or ends it.
  void FailOver(const Device& device, std::shared_ptr<Task> task, const absl::Status& failure);
  // The device failed; where that ends its service, notifies scheduler and listener.
  void Failed(Device& device, DeviceFailureKind kind, const std::string& reason);
  void Changed(Device& device);
  void RefuseStranded();

  // The watch: one thread that looks after those of the GPUs.
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
  std::atomic<int> cpu_runs_{0}, loads_{0};  // under way now

  std::mutex change_mutex_;  // one change at a time; taken before a device's lock
  std::function<void(const std::string&, bool)> listener_;

  mutable std::mutex watch_mutex_;
  std::condition_variable watch_changed_;
  bool watch_woken_ = false, watch_idle_ = false, stopping_ = false, hasty_ = false;
  std::thread watch_;
};

}  // namespace voxelpipe
