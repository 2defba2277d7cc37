// Memory that a request may take, charged before it is allocated.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string_view>
#include <utility>

#include "absl/status/status.h"

namespace voxelpipe {

// A number of bytes that many may take from. What is taken from a budget with a parent is taken from the parent as
// well, so that the budgets of all requests together stay below the server's. Thread-safe.
class MemoryBudget {
 public:
  // `parent` may be null; otherwise it must outlive this.
  explicit MemoryBudget(uint64_t limit_bytes, MemoryBudget* parent = nullptr) : limit_(limit_bytes), parent_(parent) {}
  ~MemoryBudget();
  MemoryBudget(const MemoryBudget&) = delete;
  MemoryBudget& operator=(const MemoryBudget&) = delete;

  // Takes `bytes`, or nothing. RESOURCE_EXHAUSTED naming `what` with need and limit, as numbers too
  // (base/limit_error.h); marked (IsInUseByOthers) where it is the parent that has not so much left.
  absl::Status Take(uint64_t bytes, std::string_view what) { return Take(bytes, what, true); }
  // The same without waiting.
  absl::Status TakeNow(uint64_t bytes, std::string_view what) { return Take(bytes, what, false); }
  // Asked where the parent has not so much left: waits, and returns true to try again. Set before the first Take.
  // Only the thread that calls Take waits, and several threads may wait at the same time. Without it no thread waits.
  using Wait = std::function<bool(uint64_t bytes)>;
  void set_wait(Wait wait) { wait_ = std::move(wait); }

  // Bytes of the parent that this leaves to others while others use any: what is held long must not take the last from
  // what would end soon.
  void set_leave(uint64_t bytes) { leave_.store(bytes, std::memory_order_relaxed); }
  // What can be taken from the parent now. Only for a budget with a parent.
  uint64_t available_bytes() const;

  // Gives back what Take took.
  void Give(uint64_t bytes);

  // What is taken stays taken, though it be more than the new limit.
  void set_limit_bytes(uint64_t bytes) { limit_.store(bytes, std::memory_order_relaxed); }
  uint64_t limit_bytes() const { return limit_.load(std::memory_order_relaxed); }
  uint64_t used_bytes() const { return used_.load(std::memory_order_relaxed); }
  // The same without what threads wait for.
  uint64_t held_bytes() const { return held_.load(std::memory_order_relaxed); }
  uint64_t peak_bytes() const { return peak_.load(std::memory_order_relaxed); }

 private:
  absl::Status Take(uint64_t bytes, std::string_view what, bool may_wait) {
    return TakeBelow(limit_bytes(), bytes, what, may_wait);
  }
  absl::Status TakeBelow(uint64_t limit, uint64_t bytes, std::string_view what, bool may_wait);
  // The parent's limit, less what this leaves to others.
  uint64_t parent_limit_bytes() const;

  std::atomic<uint64_t> limit_;
  MemoryBudget* const parent_;
  std::atomic<uint64_t> leave_{0};
  std::atomic<uint64_t> used_{0}, held_{0}, peak_{0};
  Wait wait_;
};

// What this process may take for requests that bring no budget of their own: half of the memory of the machine or
// container (base/machine.h).
MemoryBudget& DefaultMemory();

// Bytes of a budget that are given back when this goes. Without a budget nothing is charged and nothing refused. Not
// thread-safe.
class MemoryCharge {
 public:
  MemoryCharge() = default;
  // `budget` may be null; otherwise it must outlive this.
  explicit MemoryCharge(MemoryBudget* budget) : budget_(budget) {}
  MemoryCharge(MemoryCharge&& other) noexcept
      : budget_(std::exchange(other.budget_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}
  MemoryCharge& operator=(MemoryCharge&& other) noexcept {
    if (this == &other) return *this;
    ShrinkTo(0);
    budget_ = std::exchange(other.budget_, nullptr);
    bytes_ = std::exchange(other.bytes_, 0);
    return *this;
  }
  ~MemoryCharge() { ShrinkTo(0); }

  // Takes `bytes` more. The error is that of MemoryBudget::Take.
  absl::Status Grow(uint64_t bytes, std::string_view what);
  // Takes elements * bytes_each more, without wrapping.
  absl::Status Grow(uint64_t elements, uint64_t bytes_each, std::string_view what);
  // As the first one, but by MemoryBudget::TakeNow.
  absl::Status GrowNow(uint64_t bytes, std::string_view what);
  void ShrinkTo(uint64_t bytes);
  // Takes over what another one has taken, which must be from the same budget.
  void Absorb(MemoryCharge other) { bytes_ += std::exchange(other.bytes_, 0); }
  uint64_t bytes() const { return bytes_; }

 private:
  MemoryBudget* budget_ = nullptr;
  uint64_t bytes_ = 0;
};

}  // namespace voxelpipe
