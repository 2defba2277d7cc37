// The threads that work: loaders, and the workers of each device.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "pipeline/stages.h"
#include "work/scheduler.h"
#include "work/voxelize_job.h"

namespace voxelpipe {

struct DeviceWorkers {
  const Backend* backend = nullptr;  // see Devices() in pipeline/backend.h
  int workers = 1;                   // batches that run on it at the same time
};

struct WorkerPoolOptions {
  int loaders = 1;  // meshes that are loaded at the same time, besides small ones that workers load themselves
  std::vector<DeviceWorkers> devices;
  int threads = 0;  // of one batch on the CPU; 0 = all
};

// Takes tasks from a scheduler until it is stopped.
class WorkerPool {
 public:
  // `scheduler` must outlive the pool.
  WorkerPool(Scheduler& scheduler, const WorkerPoolOptions& options, const PlanLimits& limits);
  // Drains and stops the scheduler, and ends the threads.
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

 private:
  void LoadTasks();
  void RunBatches(const Backend& backend, const std::string& worker);
  void RunAlone(const Backend& backend, const std::string& worker, VoxelizeJob& job);
  void RunTogether(const Backend& backend, const std::string& worker, std::span<const std::shared_ptr<Task>> batch);
  absl::StatusOr<JobOutcome> Outcome(const Backend& backend, VoxelizeJob& job);

  Scheduler& scheduler_;
  const WorkerPoolOptions options_;
  const PlanLimits limits_;
  std::vector<std::thread> threads_;
};

}  // namespace voxelpipe
