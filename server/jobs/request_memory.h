// The memory of one request, which it takes from what the operator gave to all.
#pragma once

#include <algorithm>
#include <chrono>
#include <memory>
#include <mutex>

#include "base/job_context.h"
#include "base/memory_budget.h"
#include "schedule/byte_budget.h"

namespace voxelpipe {

// How long a request waits for others to free memory before its client is asked to come again: its loading in all, and
// then its plan.
inline constexpr std::chrono::milliseconds kMemoryPatience{20'000};

// The part that meshes of waiting jobs leave free: the jobs that run must get what they need to end.
inline constexpr uint64_t kLeftToOthers = 4;

// What is left of a request's patience, however many of its threads wait, and however often. Thread-safe.
class Patience {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Patience(Clock::duration left) : left_(left) {}

  // A thread begins to wait. Out: until when it may.
  Clock::time_point Begin() {
    const std::lock_guard lock(mutex_);
    if (threads_++ == 0) end_ = Clock::now() + left_;
    return end_;
  }
  // It waits no more.
  void End() {
    const std::lock_guard lock(mutex_);
    if (--threads_ == 0) left_ = std::max(end_ - Clock::now(), Clock::duration::zero());
  }

 private:
  std::mutex mutex_;
  int threads_ = 0;
  Clock::duration left_;
  Clock::time_point end_;
};

// In: what all requests share, and the context of the request's job, which must outlive its loading. Out: its budget,
// whose limit is that of all: beyond it alone, a request gets the limit's error; where others use what is left, it
// waits (ByteBudget::Take), and then gets one that is marked (IsInUseByOthers). The context is charged to it from now
// on. `working` need not outlive it.
inline std::shared_ptr<MemoryBudget> MakeRequestMemory(ByteBudget& working, JobContext& context,
                                                       std::chrono::milliseconds patience = kMemoryPatience) {
  const std::shared_ptr<MemoryBudget> all = working.memory();
  std::shared_ptr<MemoryBudget> memory(new MemoryBudget(all->limit_bytes(), all.get()),
                                       [all](MemoryBudget* own) { delete own; });
  memory->set_leave(all->limit_bytes() / kLeftToOthers);
  const auto left = std::make_shared<Patience>(patience);
  memory->set_wait([&working, &context, left, own = memory.get()](uint64_t bytes) {
    const bool there = working.WaitFor(bytes, *own, context, left->Begin());
    left->End();
    return there;
  });
  context.set_memory(memory.get());
  return memory;
}

}  // namespace voxelpipe
