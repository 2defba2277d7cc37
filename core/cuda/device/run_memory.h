// Memory that one run takes of a device, asked for before it is taken where it is more than the plan has.
#pragma once

#include <cstdint>
#include <utility>

#include "absl/status/status.h"
#include "pipeline/plan/list_memory.h"

namespace voxelpipe::cuda {

// Counts the arrays (buffer.h) that the calling thread allocates and frees from its beginning to its end, but for
// arrays that outlive runs (ApartFromRuns). It begins and ends on one thread, as the run does; of several on a thread
// the youngest counts.
class RunMemory {
 public:
  RunMemory() : before_(std::exchange(of_thread_, this)) {}
  RunMemory(const RunMemory&) = delete;
  RunMemory& operator=(const RunMemory&) = delete;
  ~RunMemory();

  // The calling thread's, or null.
  static RunMemory* OfThread() { return of_thread_; }

  // From now on `lists`, which may be null, is asked before more is taken than it ever granted.
  void AskFrom(ListMemory* lists) { lists_ = lists; }
  // False: refused, and refusal() says why.
  bool Take(uint64_t bytes);
  void Return(uint64_t bytes) { taken_ -= bytes < taken_ ? bytes : taken_; }
  // The host's memory that holds lists of the slab in work beside the device's: asked for like this, 0 at its end.
  absl::Status TakeOnHost(uint64_t bytes);
  // Counts so many bytes of the host as taken until the end of the run.
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

// While one lives, arrays that the thread allocates and frees are no run's: they are kept for others.
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
