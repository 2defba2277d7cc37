// Memory that the server holds without using it goes back to the system.
//
// Why: the allocator gives back only what lies free at the end of its arenas, so what a flood of connections, or one
// large job, took for a moment would stay with the process for good; and pooled blocks of results stay for the next
// job, which may never come.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <utility>

namespace voxelpipe {

// Where the memory lies. All functions must be set, and may be called from one thread at a time.
struct HeldMemory {
  std::function<uint64_t()> resident_bytes;  // of this process
  std::function<uint64_t()> free_bytes;      // in the allocator's hands, whether resident or not
  std::function<void()> trim;                // the allocator gives free pages to the system
  std::function<void(std::chrono::steady_clock::time_point)>
      release_blocks;  // pooled blocks unused since that moment likewise
};

// This process's: glibc's allocator, and the pool of pages.
HeldMemory MemoryOfThisProcess();

// Freed memory that the allocator may keep for each of `threads` threads that load and voxelize: a sixteenth of
// `memory_bytes` for all of them, and of each no less than 1 MiB and no more than 64.
uint64_t KeptBytesOfThread(uint64_t memory_bytes, int threads);

// From now on the allocator keeps so much for each thread. What it would give to the system after each mesh comes back
// page by page with the next one. IdleMemory gives back what stays unused.
void KeepFreedMemory(uint64_t bytes_of_thread);

// Not thread-safe.
class IdleMemory {
 public:
  using Clock = std::chrono::steady_clock;

  // Less than this is not worth a trim, which delays allocations for a millisecond or so.
  static constexpr uint64_t kWorthwhileBytes = 4 << 20;

  explicit IdleMemory(HeldMemory memory) : memory_(std::move(memory)) {}

  // Call now and then: gives back blocks that have not been used for `unused_for`, and trims the allocator if the
  // process or what is free has grown since the last time.
  void Look(std::chrono::milliseconds unused_for, Clock::time_point now = Clock::now());

 private:
  HeldMemory memory_;
  // The least of each since the last trim. Both show growth: what was in use when it was trimmed shows only in the
  // second when it becomes free, and what came and went between two looks only in the first.
  uint64_t resident_ = 0, free_ = 0;
};

}  // namespace voxelpipe
