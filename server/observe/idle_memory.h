// Returns unused memory of the server to the system.
//
// Why: the allocator returns only free memory at the end of its arenas, so memory used briefly by a burst of
// connections or one large job would stay with the process; and pooled blocks of results stay for a next job that may
// never come.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <utility>

namespace voxelpipe {

// Access to the memory. All functions must be set; they are called from one thread at a time.
struct HeldMemory {
  std::function<uint64_t()> resident_bytes;  // of this process
  std::function<uint64_t()> free_bytes;      // free in the allocator, resident or not
  std::function<void()> trim;                // makes the allocator return free pages to the system
  std::function<void(std::chrono::steady_clock::time_point)>
      release_blocks;  // returns pooled blocks unused since that moment
};

// Those of this process: glibc's allocator, and the pool of pages.
HeldMemory MemoryOfThisProcess();

// Freed memory that the allocator may keep for each of `threads` threads that load and voxelize: a sixteenth of
// `memory_bytes` for all of them, and of each no less than 1 MiB and no more than 64.
uint64_t KeptBytesOfThread(uint64_t memory_bytes, int threads);

// Makes the allocator keep this much for each thread. Otherwise it would return memory after each mesh and fault it in
// again page by page for the next one. IdleMemory returns what stays unused.
void KeepFreedMemory(uint64_t bytes_of_thread);

// Not thread-safe.
class IdleMemory {
 public:
  using Clock = std::chrono::steady_clock;

  // Less than this is not worth a trim, which delays allocations for a millisecond or so.
  static constexpr uint64_t kWorthwhileBytes = 4 << 20;

  explicit IdleMemory(HeldMemory memory) : memory_(std::move(memory)) {}

  // Call periodically: returns blocks unused for `unused_for`, and trims the allocator if the resident or the free
  // memory has grown since the last call.
  void Look(std::chrono::milliseconds unused_for, Clock::time_point now = Clock::now());

 private:
  HeldMemory memory_;
  // The minimum of each since the last trim. Both show growth: memory in use at the trim and freed later shows only in
  // the second, memory allocated and freed between two calls only in the first.
  uint64_t resident_ = 0, free_ = 0;
};

}  // namespace voxelpipe
