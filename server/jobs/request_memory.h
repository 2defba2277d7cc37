// The memory budget of one request, a child of that of all requests.
#pragma once

#include <algorithm>
#include <chrono>
#include <memory>
#include <mutex>

#include "base/job_context.h"
#include "base/memory_budget.h"
#include "schedule/byte_budget.h"

namespace voxelpipe {

// How long a request waits for others to free memory before it is refused with a retry delay: for its loading in total,
// and then for its plan.
inline constexpr std::chrono::milliseconds kMemoryPatience{20'000};

// The share that meshes of waiting jobs leave free, so that running jobs can get the memory that they need to end.
inline constexpr uint64_t kLeftToOthers = 4;

// The remaining waiting time of a request, over all waits of all its threads. Thread-safe.
class Patience {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Patience(Clock::duration left) : left_(left) {}

  // A thread begins to wait. Out: the end of its wait.
  Clock::time_point Begin() {
    const std::lock_guard lock(mutex_);
    if (threads_++ == 0) end_ = Clock::now() + left_;
    return end_;
  }
  // It ends its wait.
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

// In: the memory that all requests share, and the context of the request's job, which must outlive its loading. Out:
// its budget, whose limit is that of all. A request that exceeds the limit alone gets the error of the limit; if other
// requests use the memory, it waits (ByteBudget::Take), and then gets an error marked IsInUseByOthers. Sets the budget
// of the context. `working` need not outlive it.
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
