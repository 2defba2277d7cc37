// What a loop asks of its job, which may be null: whether it goes on, and memory.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string_view>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "base/memory_budget.h"

namespace voxelpipe {

// The budget that the memory of such work is charged to; DefaultMemory() without a job.
inline MemoryBudget& MemoryOf(const JobContext* job) {
  return job == nullptr ? DefaultMemory() : MemoryOf(*job);
}

inline absl::Status CheckJob(const JobContext* job) {
  return job == nullptr ? absl::OkStatus() : job->Check();
}

// Looks at the job every few milliseconds of a loop. Of one thread.
class JobPoll {
 public:
  explicit JobPoll(const JobContext* job) : job_(job) {}

  // After work on `units`: voxels, or words of them, each at most some hundred nanoseconds. The job's error.
  absl::Status Add(uint64_t units) {
    done_ += units;
    if (done_ < kUnits) return absl::OkStatus();
    done_ = 0;
    return CheckJob(job_);
  }

 private:
  static constexpr uint64_t kUnits = 1 << 14;

  const JobContext* job_;
  uint64_t done_ = 0;
};

// Bytes an entry of an Abseil table whose slots have `slot_bytes`, if it is as full as ChargedGrowth makes it.
constexpr uint64_t TableEntryBytes(uint64_t slot_bytes) {
  return (slot_bytes + 1) * 8 / 7 + 1;
}

// Lists and tables that become twice as large when they are full: charges their memory before they do.
class ChargedGrowth {
 public:
  // `bytes_each`: of an entry in all of them together. `what` must outlive this.
  ChargedGrowth(MemoryBudget& budget, uint64_t bytes_each, std::string_view what)
      : charge_(&budget), bytes_each_(bytes_each), what_(what) {}

  // Call before one of the containers has more than `entries`. The error of MemoryBudget::Take.
  template <typename... Containers>
  absl::Status Reach(uint64_t entries, Containers&... containers) {
    if (entries <= capacity_) return absl::OkStatus();
    uint64_t capacity = std::max(kFirst, 2 * capacity_);
    while (capacity < entries) capacity *= 2;
    // While entries move, their old and their new place exist.
    if (absl::Status s = charge_.Grow(capacity, bytes_each_, what_); !s.ok()) return s;
    (containers.reserve(capacity), ...);
    charge_.ShrinkTo(capacity * bytes_each_);
    capacity_ = capacity;
    return absl::OkStatus();
  }

  // The memory of all entries, which may outlive this.
  MemoryCharge TakeCharge() { return std::move(charge_); }

 private:
  static constexpr uint64_t kFirst = 7 << 4;  // 7 * 2^n entries fill a table of Abseil to its limit

  MemoryCharge charge_;
  uint64_t bytes_each_, capacity_ = 0;
  std::string_view what_;
};

}  // namespace voxelpipe
