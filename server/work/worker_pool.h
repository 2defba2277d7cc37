// A fixed number of threads and a bounded queue: what the server promises to do, and no more.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "absl/status/statusor.h"

namespace voxelpipe {

// Thread-safe.
class WorkerPool {
 public:
  using Job = std::function<void()>;
  using Ticket = uint64_t;

  // `workers` jobs run at the same time (at least 1), `max_queue` more may wait.
  WorkerPool(int workers, size_t max_queue);
  // Drains.
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  // Runs `job` on a worker, first come, first served. `job` must not throw.
  // Errors: a BusyError when every worker is taken and the queue is full; UNAVAILABLE after Drain began.
  absl::StatusOr<Ticket> Submit(Job job);

  // Takes a job that still waits out of the queue: true if it was there, and then it never runs.
  bool Withdraw(Ticket ticket);

  // Refuses new jobs and returns when all accepted ones have ended.
  void Drain();

  size_t queued() const;
  size_t running() const;

 private:
  struct Waiting {
    Ticket ticket;
    Job job;
  };

  void Work();

  const size_t max_queue_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Waiting> queue_;
  Ticket next_ticket_ = 1;
  size_t running_ = 0;
  bool draining_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace voxelpipe
