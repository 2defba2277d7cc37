// The memory of one request, which it takes of what the operator gave to all.
#pragma once

#include <chrono>
#include <memory>

#include "base/job_context.h"
#include "base/memory_budget.h"
#include "work/byte_budget.h"

namespace voxelpipe {

// How long a request waits for others to free memory before its client is asked to come again.
inline constexpr std::chrono::milliseconds kMemoryPatience{20'000};

// The part that meshes of waiting jobs leave free: the jobs that run must get what they need to end.
inline constexpr uint64_t kLeftToOthers = 4;

// In: what all requests share, and the context of the request's job, which must outlive its loading. Out: its budget, whose limit is that of
// all: beyond it alone, a request gets the limit's error; where others use what is left, it waits (ByteBudget::Take), and then gets one that is
// marked (IsInUseByOthers). The context takes of it from now on. `working` need not outlive it.
inline std::shared_ptr<MemoryBudget> MakeRequestMemory(ByteBudget& working, JobContext& context) {
  const std::shared_ptr<MemoryBudget> all = working.memory();
  std::shared_ptr<MemoryBudget> memory(new MemoryBudget(all->limit_bytes(), all.get()),
                                       [all](MemoryBudget* own) { delete own; });
  const uint64_t leave = all->limit_bytes() / kLeftToOthers;
  memory->set_leave(leave);
  memory->set_wait([&working, &context, leave, own = memory.get()](uint64_t bytes) {
    // What it is about to take is counted as its own already.
    return working.WaitFor(bytes, leave, context, kMemoryPatience, own->used_bytes() - bytes);
  });
  context.set_memory(memory.get());
  return memory;
}

}  // namespace voxelpipe
