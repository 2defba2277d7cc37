// Memory budgets: what a request may allocate, charged before it is allocated.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string_view>
#include <utility>

#include "absl/status/status.h"

namespace voxelpipe {

// A number of bytes shared by several users. Bytes taken from a budget are taken from its parent as well, so that the
// budgets of all requests together stay below the server's. Thread-safe.
class MemoryBudget {
 public:
  // `parent` may be null; otherwise it must outlive this.
  explicit MemoryBudget(uint64_t limit_bytes, MemoryBudget* parent = nullptr) : limit_(limit_bytes), parent_(parent) {}
  ~MemoryBudget();
  MemoryBudget(const MemoryBudget&) = delete;
  MemoryBudget& operator=(const MemoryBudget&) = delete;

  // Takes all of `bytes`, or none. RESOURCE_EXHAUSTED naming `what` with need and limit, as numbers too
  // (base/limit_error.h); marked (IsInUseByOthers) if the parent has too little left.
  absl::Status Take(uint64_t bytes, std::string_view what) { return Take(bytes, what, true); }
  // The same without waiting.
  absl::Status TakeNow(uint64_t bytes, std::string_view what) { return Take(bytes, what, false); }
  // Called if the parent has too little left: waits, and returns true to try again. Set before the first Take. Only the
  // thread that calls Take waits, and several threads may wait at the same time. Without it no thread waits.
  using Wait = std::function<bool(uint64_t bytes)>;
  void set_wait(Wait wait) { wait_ = std::move(wait); }

  // Bytes of the parent that this budget leaves free while others use any: long-lived charges must not take the last
  // bytes from short-lived ones.
  void set_leave(uint64_t bytes) { leave_.store(bytes, std::memory_order_relaxed); }
  // Bytes that can be taken from the parent now. Only for a budget with a parent.
  uint64_t available_bytes() const;

  // Returns bytes that Take took.
  void Give(uint64_t bytes);

  // Bytes already taken stay taken, even beyond the new limit.
  void set_limit_bytes(uint64_t bytes) { limit_.store(bytes, std::memory_order_relaxed); }
  uint64_t limit_bytes() const { return limit_.load(std::memory_order_relaxed); }
  uint64_t used_bytes() const { return used_.load(std::memory_order_relaxed); }
  // The same without the bytes that threads wait for.
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

// The budget for requests without one of their own: half of the memory of the machine or container (base/machine.h).
MemoryBudget& DefaultMemory();

// RAII charge to a budget: the destructor returns its bytes. Without a budget nothing is charged or refused. Not
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
  // Like the first one, with MemoryBudget::TakeNow.
  absl::Status GrowNow(uint64_t bytes, std::string_view what);
  void ShrinkTo(uint64_t bytes);
  // Moves the bytes of another charge to this one; both must be of the same budget.
  void Absorb(MemoryCharge other) { bytes_ += std::exchange(other.bytes_, 0); }
  uint64_t bytes() const { return bytes_; }

 private:
  MemoryBudget* budget_ = nullptr;
  uint64_t bytes_ = 0;
};

}  // namespace voxelpipe
