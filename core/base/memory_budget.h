// Memory that a request may take, charged before it is allocated.
#pragma once

#include <atomic>
#include <cstdint>
#include <string_view>
#include <utility>

#include "absl/status/status.h"

namespace voxelpipe {

// A number of bytes that many may take from. A budget with a parent takes from the parent as well, so that the budgets of all requests
// together stay below the server's. Thread-safe.
class MemoryBudget {
 public:
  // `parent` may be null; otherwise it must outlive this.
  explicit MemoryBudget(uint64_t limit_bytes, MemoryBudget* parent = nullptr) : limit_(limit_bytes), parent_(parent) {}
  ~MemoryBudget();
  MemoryBudget(const MemoryBudget&) = delete;
  MemoryBudget& operator=(const MemoryBudget&) = delete;

  // Takes `bytes`, or nothing. RESOURCE_EXHAUSTED naming `what` with need and limit, as numbers too (base/limit_error.h).
  absl::Status Take(uint64_t bytes, std::string_view what);
  // Gives back what Take took.
  void Give(uint64_t bytes);

  uint64_t limit_bytes() const { return limit_; }
  uint64_t used_bytes() const { return used_.load(std::memory_order_relaxed); }
  uint64_t peak_bytes() const { return peak_.load(std::memory_order_relaxed); }

 private:
  const uint64_t limit_;
  MemoryBudget* const parent_;
  std::atomic<uint64_t> used_{0}, peak_{0};
};

// Bytes of a budget that are given back when this goes. Without a budget nothing is charged and nothing refused. Not thread-safe.
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
  void ShrinkTo(uint64_t bytes);
  uint64_t bytes() const { return bytes_; }

 private:
  MemoryBudget* budget_ = nullptr;
  uint64_t bytes_ = 0;
};

}  // namespace voxelpipe
