// The pool's state of each device and of each thread. For the pool's own files.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "observe/metrics.h"
#include "run/worker_pool.h"

namespace voxelpipe {

// Shared with its workers' threads, because some may be abandoned.
struct WorkerPool::Device {
  Device(const DeviceWorkers& of, const WorkerPoolOptions& options);

  const Backend& backend;
  const WorkerTraits traits;
  std::atomic<int> workers;  // changed with the pool's change_mutex_ and this mutex
  const bool watched;
  DeviceMetrics* const metrics;  // null: without metrics; not for abandoned threads
  bool told_serving = true;      // with the pool's change_mutex_

  mutable std::mutex mutex;
  std::condition_variable changed;
  DeviceHealth health;
  bool stopping = false;
  size_t away = 0;  // abandoned threads
  int next_number = 0;
  std::vector<std::shared_ptr<Worker>> crew;  // without abandoned ones
};

// The device's lock guards its current state.
struct WorkerPool::Worker {
  Worker(std::shared_ptr<Device> of, int its_number, std::string called)
      : device(std::move(of)), number(its_number), name(std::move(called)) {}

  const std::shared_ptr<Device> device;
  const int number;
  const std::string name;  // "cuda:0/1"
  std::shared_ptr<DeviceRun> run;
  std::optional<Clock::time_point> probing_since;
  bool is_left_behind = false, ended = false;
  std::thread thread;
};

}  // namespace voxelpipe
