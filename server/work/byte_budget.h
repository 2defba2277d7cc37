// Bytes that all requests of the server share: uploads that wait, and memory that jobs work in.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <utility>

#include "base/job_context.h"

namespace voxelpipe {

// Thread-safe.
class ByteBudget {
 public:
  explicit ByteBudget(uint64_t limit) : limit_(limit) {}

  // Takes `bytes` if they are there now.
  bool TryTake(uint64_t bytes) {
    const std::lock_guard lock(mutex_);
    if (!Fits(bytes)) return false;
    used_ += bytes;
    return true;
  }

  // Waits for `bytes` to be there. False when the job ended first or `timeout` passed.
  bool Take(uint64_t bytes, const JobContext& job, std::chrono::milliseconds timeout) {
    const auto end = std::chrono::steady_clock::now() + timeout;
    std::unique_lock lock(mutex_);
    while (!Fits(bytes)) {
      if (!job.Check().ok() || std::chrono::steady_clock::now() >= end) return false;
      freed_.wait_for(lock, std::chrono::milliseconds(20));  // a cancelled job is not notified
    }
    used_ += bytes;
    return true;
  }

  void Give(uint64_t bytes) {
    {
      const std::lock_guard lock(mutex_);
      used_ -= bytes;
    }
    freed_.notify_all();
  }

  // What is taken stays taken, though it be more than the new limit.
  void set_limit(uint64_t limit) {
    {
      const std::lock_guard lock(mutex_);
      limit_ = limit;
    }
    freed_.notify_all();
  }
  uint64_t limit() const {
    const std::lock_guard lock(mutex_);
    return limit_;
  }
  uint64_t used() const {
    const std::lock_guard lock(mutex_);
    return used_;
  }

 private:
  bool Fits(uint64_t bytes) const { return used_ <= limit_ && bytes <= limit_ - used_; }

  mutable std::mutex mutex_;
  uint64_t limit_;
  std::condition_variable freed_;
  uint64_t used_ = 0;
};

// A share of a budget, given back when it goes. The budget must outlive it. Not thread-safe.
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

  bool Grow(uint64_t bytes, const JobContext& job, std::chrono::milliseconds timeout) {
    if (!budget_.Take(bytes, job, timeout)) return false;
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
