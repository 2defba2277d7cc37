// Device memory of one run. Beyond the plan's bytes, the run asks for permission before it allocates.
#pragma once

#include <cstdint>
#include <utility>

#include "absl/status/status.h"
#include "pipeline/plan/list_memory.h"

namespace voxelpipe::cuda {

// Counts the arrays (buffer.h) that the calling thread allocates and frees during this object's life, except arrays
// that outlive runs (ApartFromRuns). Constructed and destroyed on the run's thread; if objects nest on a thread, the
// innermost counts.
class RunMemory {
 public:
  RunMemory() : before_(std::exchange(of_thread_, this)) {}
  RunMemory(const RunMemory&) = delete;
  RunMemory& operator=(const RunMemory&) = delete;
  ~RunMemory();

  // The calling thread's innermost object, or null.
  static RunMemory* OfThread() { return of_thread_; }

  // From now on asks `lists` (may be null) before it takes more than was ever granted.
  void AskFrom(ListMemory* lists) { lists_ = lists; }
  // False if refused: refusal() has the reason.
  bool Take(uint64_t bytes);
  void Return(uint64_t bytes) { taken_ -= bytes < taken_ ? bytes : taken_; }
  // Charges host memory that mirrors the current slab's lists on the device, with the same request; 0 at its end.
  absl::Status TakeOnHost(uint64_t bytes);
  // Counts `bytes` of host memory as taken until the end of the run.
  void KeepOnHost(uint64_t bytes) { taken_ += bytes; }

  uint64_t taken_bytes() const { return taken_; }
  const absl::Status& refusal() const { return refusal_; }

 private:
  friend class ApartFromRuns;
  absl::Status Ask();

  static thread_local RunMemory* of_thread_;

  RunMemory* before_;
  ListMemory* lists_ = nullptr;
  uint64_t taken_ = 0, on_host_ = 0, granted_ = 0;
  absl::Status refusal_;
};

// During its life, arrays that the thread allocates and frees are charged to no run: the caches own them.
class ApartFromRuns {
 public:
  ApartFromRuns() : before_(std::exchange(RunMemory::of_thread_, nullptr)) {}
  ApartFromRuns(const ApartFromRuns&) = delete;
  ApartFromRuns& operator=(const ApartFromRuns&) = delete;
  ~ApartFromRuns() { RunMemory::of_thread_ = before_; }

 private:
  RunMemory* const before_;
};

}  // namespace voxelpipe::cuda
