#include "support/counting_memory.h"

#include <malloc.h>
#include <sys/mman.h>

#include <atomic>
#include <cerrno>
#include <cstddef>

#include "support/sanitized.h"

namespace {

std::atomic<uint64_t> allocated{0}, peak{0};

void Count(uint64_t bytes) {
  const uint64_t now = allocated.fetch_add(bytes, std::memory_order_relaxed) + bytes;
  uint64_t most = peak.load(std::memory_order_relaxed);
  while (most < now && !peak.compare_exchange_weak(most, now, std::memory_order_relaxed)) {}
}

void Discount(uint64_t bytes) {
  allocated.fetch_sub(bytes, std::memory_order_relaxed);
}

constexpr bool kCounts = !voxelpipe::testing::kSanitized;

}  // namespace

// The page pool's mappings; the linker sends it here (--wrap). Others' mappings are none of its: a driver reserves
// addresses by the gigabyte.
extern "C" {
void* __real_mmap(void* address, size_t bytes, int protection, int flags, int file, off_t offset);
int __real_munmap(void* address, size_t bytes);
void* __wrap_mmap(void* address, size_t bytes, int protection, int flags, int file, off_t offset) {
  void* const mapped = __real_mmap(address, bytes, protection, flags, file, offset);
  if (mapped != MAP_FAILED && (flags & MAP_ANONYMOUS) != 0) Count(bytes);
  return mapped;
}
int __wrap_munmap(void* address, size_t bytes) {
  const int result = __real_munmap(address, bytes);
  if (result == 0) Discount(bytes);
  return result;
}
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
// In place of glibc's, for every library of the process.
extern "C" {
void* __libc_malloc(size_t bytes);
void* __libc_calloc(size_t count, size_t bytes);
void* __libc_realloc(void* block, size_t bytes);
void* __libc_memalign(size_t alignment, size_t bytes);
void __libc_free(void* block);

static void* Counted(void* block) {
  if (block != nullptr) Count(malloc_usable_size(block));
  return block;
}
void* malloc(size_t bytes) {
  return Counted(__libc_malloc(bytes));
}
void* calloc(size_t count, size_t bytes) {
  return Counted(__libc_calloc(count, bytes));
}
void free(void* block) {
  if (block == nullptr) return;
  Discount(malloc_usable_size(block));
  __libc_free(block);
}
void* realloc(void* block, size_t bytes) {
  const uint64_t before = block == nullptr ? 0 : malloc_usable_size(block);
  void* const moved = __libc_realloc(block, bytes);
  if (moved == nullptr && bytes != 0) return nullptr;
  Discount(before);
  return Counted(moved);
}
void* memalign(size_t alignment, size_t bytes) {
  return Counted(__libc_memalign(alignment, bytes));
}
void* aligned_alloc(size_t alignment, size_t bytes) {
  return Counted(__libc_memalign(alignment, bytes));
}
int posix_memalign(void** out, size_t alignment, size_t bytes) {
  *out = Counted(__libc_memalign(alignment, bytes));
  return *out == nullptr ? ENOMEM : 0;
}
}
#endif

namespace voxelpipe::testing {

bool CountsMemory() {
  return kCounts;
}
uint64_t AllocatedBytes() {
  return allocated.load(std::memory_order_relaxed);
}
uint64_t AllocatedPeak() {
  return peak.load(std::memory_order_relaxed);
}
void ResetAllocatedPeak() {
  peak.store(allocated.load(std::memory_order_relaxed), std::memory_order_relaxed);
}

}  // namespace voxelpipe::testing
