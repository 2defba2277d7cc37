#include "grid/page_pool.h"

#include <sys/mman.h>

#include <algorithm>
#include <cstdlib>
#include <deque>
#include <mutex>

#include "base/machine_memory.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kLine = 64;
constexpr uint64_t kHugePage = 2 << 20;
constexpr uint64_t kMostIdleBytes = 1ull << 30;
constexpr uint64_t kIdleShare = 8;  // of the machine's memory

// AddressSanitizer should see every block end where it ends.
#if defined(__SANITIZE_ADDRESS__)
constexpr bool kPool = false;
#else
constexpr bool kPool = true;
#endif

uint64_t RoundUp(uint64_t bytes, uint64_t multiple) {
  return (bytes + multiple - 1) / multiple * multiple;
}

// The size that a block of `bytes` really has: few sizes, so that blocks fit again.
uint64_t BlockBytes(uint64_t bytes) {
  const uint64_t lines = RoundUp(bytes == 0 ? 1 : bytes, kLine);
  return lines < kPooledBytes || !kPool ? lines : RoundUp(lines, kHugePage);
}

class Pool {
 public:
  void* Take(uint64_t size) {
    const std::lock_guard lock(mutex_);
    // The newest block of that size is the one most likely in cache.
    for (auto block = idle_.rbegin(); block != idle_.rend(); ++block) {
      if (block->size != size) continue;
      void* const address = block->address;
      idle_bytes_ -= size;
      idle_.erase(std::next(block).base());
      return address;
    }
    return nullptr;
  }

  void Return(void* address, uint64_t size) {
    const std::lock_guard lock(mutex_);
    idle_.push_back({address, size});
    idle_bytes_ += size;
    Shrink(most_idle_);
  }

  void Release() {
    const std::lock_guard lock(mutex_);
    Shrink(0);
  }

 private:
  struct Block {
    void* address;
    uint64_t size;
  };

  void Shrink(uint64_t most) {
    for (; idle_bytes_ > most; idle_.pop_front()) {
      idle_bytes_ -= idle_.front().size;
      std::free(idle_.front().address);
    }
  }

  std::mutex mutex_;
  std::deque<Block> idle_;  // oldest first
  uint64_t idle_bytes_ = 0;
  const uint64_t most_idle_ = std::max(kMostIdleBytes, MemoryBytes() / kIdleShare);
};

Pool& ThePool() {
  static Pool* pool = new Pool;  // never destroyed: buffers may outlive static objects
  return *pool;
}

}  // namespace

void* TakePages(uint64_t bytes) {
  if (bytes > UINT64_MAX - kHugePage) return nullptr;
  const uint64_t size = BlockBytes(bytes);
  if (size < kPooledBytes || !kPool) return std::aligned_alloc(kLine, size);
  if (void* const block = ThePool().Take(size)) return block;
  void* block = std::aligned_alloc(kHugePage, size);
  if (block == nullptr) {  // idle blocks may be what is missing
    ReleaseIdlePages();
    block = std::aligned_alloc(kHugePage, size);
  }
  // One fault a huge page in place of 512; where the system has none, nothing is lost.
  if (block != nullptr) madvise(block, size, MADV_HUGEPAGE);
  return block;
}

void ReturnPages(void* block, uint64_t bytes) {
  if (block == nullptr) return;
  const uint64_t size = BlockBytes(bytes);
  if (size < kPooledBytes || !kPool) return std::free(block);
  ThePool().Return(block, size);
}

void ReleaseIdlePages() {
  ThePool().Release();
}

}  // namespace voxelpipe
