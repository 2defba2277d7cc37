// What a running job shares with its caller: a cancel flag, a deadline, progress, and the memory that it may take.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <optional>
#include <string_view>

#include "absl/status/status.h"
#include "base/memory_budget.h"

namespace voxelpipe {

// Thread-safe for concurrent Check() and Cancel(). Owned by the caller; must outlive the job.
class JobContext {
 public:
  using Clock = std::chrono::steady_clock;
  // Called from the thread that runs the stage, at most a few times a stage, never concurrently. `stage` is one of the
  // stage names of job/stats.h, `fraction` is in [0, 1] within that stage.
  using Progress = std::function<void(std::string_view stage, double fraction)>;

  JobContext() = default;
  explicit JobContext(Progress progress) : progress_(std::move(progress)) {}

  void Cancel() { cancelled_.store(true, std::memory_order_relaxed); }
  void set_deadline(Clock::time_point deadline) { deadline_ = deadline; }
  const std::optional<Clock::time_point>& deadline() const { return deadline_; }

  // OK while the job may continue; CANCELLED after Cancel(); DEADLINE_EXCEEDED after the deadline. Cheap enough to be
  // called between tiles.
  absl::Status Check() const {
    if (cancelled_.load(std::memory_order_relaxed)) return absl::CancelledError("the job was cancelled");
    if (deadline_ && Clock::now() >= *deadline_) return absl::DeadlineExceededError("the job's deadline has passed");
    return absl::OkStatus();
  }

  // The budget that the job is charged to. Null: only loading is charged, to DefaultMemory(). Set before the job
  // starts; must outlive it and the scenes and meshes that it made.
  void set_memory(MemoryBudget* memory) { memory_ = memory; }
  MemoryBudget* memory() const { return memory_; }

  void Report(std::string_view stage, double fraction) const {
    if (progress_) progress_(stage, fraction);
  }

 private:
  std::atomic<bool> cancelled_{false};
  std::optional<Clock::time_point> deadline_;
  Progress progress_;
  MemoryBudget* memory_ = nullptr;
};

// The budget that loading for the job is charged to.
inline MemoryBudget& MemoryOf(const JobContext& job) {
  return job.memory() != nullptr ? *job.memory() : DefaultMemory();
}

}  // namespace voxelpipe
