// Bytes that all requests of the server share: waiting uploads, and the working memory of jobs.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <utility>

#include "base/job_context.h"
#include "base/memory_budget.h"

namespace voxelpipe {

// A MemoryBudget with waiting. Thread-safe.
class ByteBudget {
 public:
  explicit ByteBudget(uint64_t limit) : memory_(std::make_shared<MemoryBudget>(limit)) {}

  // Takes `bytes` if they are available now.
  bool TryTake(uint64_t bytes) { return memory_->Take(bytes, "the job").ok(); }

  // Waits until `bytes` are available. False if the job ended first or `timeout` passed, or if no job can free memory
  // because waiting jobs hold all of it. `held`: bytes of it held by the caller.
  bool Take(uint64_t bytes, const JobContext& job, std::chrono::milliseconds timeout, uint64_t held = 0) {
    if (TryTake(bytes)) return true;
    const auto end = std::chrono::steady_clock::now() + timeout;
    return WaitUntil([&] { return TryTake(bytes); }, job, end, [held] { return held; });
  }
  // Waits, at most until `end`, until `own` could take `bytes`, and takes nothing. The parent of `own` is memory().
  // Several threads of a job may wait at the same time.
  bool WaitFor(uint64_t bytes, const MemoryBudget& own, const JobContext& job,
               std::chrono::steady_clock::time_point end) {
    return WaitUntil([&] { return bytes <= own.available_bytes(); }, job, end, [&] { return own.held_bytes(); });
  }

  void Give(uint64_t bytes) {
    memory_->Give(bytes);
    freed_.notify_all();
  }

  // Bytes already taken stay taken, even beyond the new limit.
  void set_limit(uint64_t limit) {
    memory_->set_limit_bytes(limit);
    freed_.notify_all();
  }
  uint64_t limit() const { return memory_->limit_bytes(); }
  uint64_t used() const { return memory_->used_bytes(); }

  // The parent of the budgets of requests. It lives as long as they do.
  const std::shared_ptr<MemoryBudget>& memory() const { return memory_; }

 private:
  struct Waiting {
    int threads = 0;
    uint64_t held = 0;
  };

  // `held`: returns the bytes that the job holds now.
  template <typename Done, typename Held>
  bool WaitUntil(const Done& done, const JobContext& job, std::chrono::steady_clock::time_point end, const Held& held) {
    std::unique_lock lock(mutex_);
    Waiting& own = waiting_[&job];  // counts the bytes of a job once for all its threads
    ++own.threads;
    bool good = false;
    // Checks the job first, so that a repeated caller sees its end.
    while (job.Check().ok()) {
      good = done();
      if (good || std::chrono::steady_clock::now() >= end) break;
      waiting_held_ -= own.held;
      own.held = held();
      waiting_held_ += own.held;
      if (own.held > 0 && waiting_held_ >= used()) break;
      // Polls: neither a cancelled job nor memory freed by a request's own budget sends a notification.
      freed_.wait_for(lock, std::chrono::milliseconds(20));
    }
    if (--own.threads == 0) {
      waiting_held_ -= own.held;
      waiting_.erase(&job);
    }
    return good;
  }

  const std::shared_ptr<MemoryBudget> memory_;
  std::mutex mutex_;
  std::condition_variable freed_;
  std::map<const JobContext*, Waiting> waiting_;
  uint64_t waiting_held_ = 0;  // by all of them together
};

// RAII share of a budget, released by the destructor. The budget must outlive it. Not thread-safe.
class BudgetShare {
 public:
  explicit BudgetShare(ByteBudget& budget) : budget_(budget) {}
  ~BudgetShare() { ShrinkTo(0); }
  BudgetShare(const BudgetShare&) = delete;
  BudgetShare& operator=(const BudgetShare&) = delete;

  bool TryGrow(uint64_t bytes) {
    if (!budget_.TryTake(bytes)) return false;
    bytes_ += bytes;
    return true;
  }

  // `held`: further bytes of the caller, see ByteBudget::Take.
  bool Grow(uint64_t bytes, const JobContext& job, std::chrono::milliseconds timeout, uint64_t held = 0) {
    if (!budget_.Take(bytes, job, timeout, held + bytes_)) return false;
    bytes_ += bytes;
    return true;
  }

  void ShrinkTo(uint64_t bytes) {
    if (bytes < bytes_) budget_.Give(std::exchange(bytes_, bytes) - bytes);
  }

  uint64_t bytes() const { return bytes_; }
  const ByteBudget& budget() const { return budget_; }

 private:
  ByteBudget& budget_;
  uint64_t bytes_ = 0;
};

}  // namespace voxelpipe
