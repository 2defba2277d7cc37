// Memory of lists whose lengths a plan only estimates: what they come to take beyond the plan is taken from the job's
// budget before it is allocated.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <utility>

#include "absl/status/status.h"
#include "base/memory_budget.h"

namespace voxelpipe {

class ListMemory {
 public:
  // In: the job's budget, from which the plan's bytes are taken already, or null; the lists' part of the plan's bytes;
  // how many bytes more the plan's limits allow.
  ListMemory(MemoryBudget* budget, uint64_t planned, uint64_t room) : charge_(budget), planned_(planned), room_(room) {}

  // Asks for `bytes` of lists of the slab in work, all of them, beside those that are held. Once granted they stay so.
  // Thread-safe. RESOURCE_EXHAUSTED: the budget's, or beyond the plan's limits; then refused_bytes() says how much.
  absl::Status Need(uint64_t bytes);
  // The slab is done: so many bytes of its lists are held until the end of the run.
  void Hold(uint64_t bytes);

  // The most beyond the plan that was asked for in vain because of the plan's limits; 0 where nothing was.
  uint64_t refused_bytes() const;

 private:
  mutable std::mutex mutex_;
  MemoryCharge charge_;
  const uint64_t planned_, room_;
  uint64_t held_ = 0, granted_ = 0, refused_ = 0;
};

// Adds up what several threads are about to put into lists of a slab, and asks a ListMemory now and then. Thread-safe.
class ListCount {
 public:
  // `memory` may be null: then everything is granted. `already`: bytes that are in the lists from the beginning.
  ListCount(ListMemory* memory, uint64_t already) : memory_(memory), bytes_(already) {}

  // False once something was refused: the caller stops, and status() returns the reason.
  bool Add(uint64_t bytes) {
    const uint64_t before = bytes_.fetch_add(bytes, std::memory_order_relaxed), now = before + bytes;
    if (memory_ != nullptr && before / kStep != now / kStep) Ask((now / kStep + 1) * kStep);
    return !stop_.load(std::memory_order_relaxed);
  }
  bool stopped() const { return stop_.load(std::memory_order_relaxed); }
  uint64_t bytes() const { return bytes_.load(std::memory_order_relaxed); }
  absl::Status status() const {
    const std::lock_guard lock(mutex_);
    return status_;
  }

 private:
  void Ask(uint64_t bytes);

  static constexpr uint64_t kStep = 1 << 20;  // bytes between two questions

  ListMemory* const memory_;
  std::atomic<uint64_t> bytes_;
  std::atomic<bool> stop_{false};
  mutable std::mutex mutex_;
  absl::Status status_;
};

}  // namespace voxelpipe
