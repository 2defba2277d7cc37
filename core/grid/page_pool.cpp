#include "grid/page_pool.h"

#include <sys/mman.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <deque>
#include <mutex>
#include <optional>
#include <vector>

#include "base/machine.h"
#include "grid/idle_pages.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kLine = 64;
constexpr uint64_t kHugePage = kPooledUnit;
constexpr uint64_t kMaxIdleBytes = 1ull << 30;
constexpr uint64_t kIdleShare = 8;  // of the machine's memory

// With AddressSanitizer every block has its exact size.
#if defined(__SANITIZE_ADDRESS__)
constexpr bool kPool = false;
#else
constexpr bool kPool = true;
#endif

uint64_t RoundUp(uint64_t bytes, uint64_t multiple) {
  return (bytes + multiple - 1) / multiple * multiple;
}

// The size of a block for `bytes`: few distinct sizes, so that blocks can be reused.
uint64_t BlockBytes(uint64_t bytes) {
  const uint64_t lines = RoundUp(bytes == 0 ? 1 : bytes, kLine);
  return lines < kPooledBytes || !kPool ? lines : RoundUp(lines, kHugePage);
}

// A block in a mapping of its own, on huge pages if the system has them: one fault instead of 512. Not from the
// allocator: in its arenas the system would also turn the space between small allocations into huge pages. nullptr if
// memory is short.
void* Map(uint64_t size) {
  // A mapping larger by one huge page contains a range of this size that is aligned to huge pages.
  void* const mapped = mmap(nullptr, size + kHugePage, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (mapped == MAP_FAILED) return nullptr;
  uint8_t* const first = static_cast<uint8_t*>(mapped);
  const uint64_t before = (kHugePage - reinterpret_cast<uintptr_t>(first) % kHugePage) % kHugePage;
  uint8_t* const block = first + before;
  if (before > 0) munmap(first, before);
  munmap(block + size, kHugePage - before);
  madvise(block, size, MADV_HUGEPAGE);
  return block;
}

void Unmap(void* block, uint64_t size) {
  munmap(block, size);
}

using Clock = std::chrono::steady_clock;

class Pool {
 public:
  void* Take(uint64_t size) {
    Block rest{nullptr, 0, {}};
    void* const address = TakeBlock(size, rest);
    // Without the lock, as in FreeOldest.
    if (rest.size > 0) Unmap(rest.address, rest.size);
    return address;
  }

  void Return(void* address, uint64_t size) {
    const Clock::time_point now = Clock::now();
    FreeOldest([&](const Block&) { return idle_bytes_ > most_idle_; }, Block{address, size, now});
  }

  void Release() {
    FreeOldest([](const Block&) { return true; });
  }

  void ReleaseIdleSince(Clock::time_point moment) {
    FreeOldest([moment](const Block& block) { return block.since <= moment; });
  }

 private:
  struct Block {
    void* address;
    uint64_t size;
    Clock::time_point since;  // when it was returned
  };

  // An idle block, or a part of one; `rest` is to be freed to the system. nullptr if there is none.
  void* TakeBlock(uint64_t size, Block& rest) {
    const std::lock_guard lock(mutex_);
    // The newest block of that size is the one most likely in cache.
    for (auto block = idle_.rbegin(); block != idle_.rend(); ++block) {
      if (block->size != size) continue;
      void* const address = block->address;
      idle_bytes_ -= size;
      idle_.erase(std::next(block).base());
      return address;
    }
    // Sizes of consecutive slabs and lists differ a little: take a part of the smallest idle block that is not much
    // larger, instead of a fresh block.
    auto best = idle_.end();
    for (auto block = idle_.begin(); block != idle_.end(); ++block) {
      const bool fits = block->size > size && block->size - size <= size / 2;
      if (fits && (best == idle_.end() || block->size < best->size)) best = block;
    }
    if (best == idle_.end()) return nullptr;
    auto* const address = static_cast<uint8_t*>(best->address);
    rest = {address + size, best->size - size, {}};
    idle_bytes_ -= best->size;
    idle_.erase(best);
    return address;
  }

  // Adds `returned`, then frees the oldest blocks while `too_much(block)`. Without the lock: freeing a large block
  // takes milliseconds, and other threads must not wait.
  template <typename TooMuch>
  void FreeOldest(const TooMuch& too_much, std::optional<Block> returned = std::nullopt) {
    std::vector<Block> freed;
    {
      const std::lock_guard lock(mutex_);
      if (returned) {
        idle_.push_back(*returned);
        idle_bytes_ += returned->size;
      }
      for (; !idle_.empty() && too_much(idle_.front()); idle_.pop_front()) {
        idle_bytes_ -= idle_.front().size;
        freed.push_back(idle_.front());
      }
    }
    for (const Block& block : freed) Unmap(block.address, block.size);
  }

  std::mutex mutex_;
  std::deque<Block> idle_;  // oldest first
  uint64_t idle_bytes_ = 0;
  // In a small container, not more than its share.
  const uint64_t most_idle_ = std::min(std::max(kMaxIdleBytes, MemoryBytes() / kIdleShare), MemoryBytes() / 4);
};

Pool& ThePool() {
  static Pool* pool = new Pool;  // never destroyed: buffers may outlive static objects
  return *pool;
}

}  // namespace

void* TakePages(uint64_t bytes) {
  if (bytes > UINT64_MAX - 2 * kHugePage) return nullptr;  // room for rounding and aligning
  const uint64_t size = BlockBytes(bytes);
  if (size < kPooledBytes || !kPool) return std::aligned_alloc(kLine, size);
  if (void* const block = ThePool().Take(size)) return block;
  void* block = Map(size);
  if (block == nullptr) {  // free idle blocks and try again
    ReleaseIdlePages();
    block = Map(size);
  }
  return block;
}

void ReturnPages(void* block, uint64_t bytes) {
  if (block == nullptr) return;
  const uint64_t size = BlockBytes(bytes);
  if (size < kPooledBytes || !kPool) return std::free(block);
  ThePool().Return(block, size);
}

void DiscardPages(void* block, uint64_t bytes) {
  if (block == nullptr) return;
  const uint64_t size = BlockBytes(bytes);
  if (size < kPooledBytes || !kPool) return std::free(block);
  Unmap(block, size);
}

void ReleaseIdlePages() {
  ThePool().Release();
}

void ReleasePagesIdleSince(Clock::time_point moment) {
  ThePool().ReleaseIdleSince(moment);
}

}  // namespace voxelpipe
