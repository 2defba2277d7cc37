// Large arrays on huge pages: one page fault in place of 512, each of which costs a microsecond or two.
#pragma once

#include <sys/mman.h>

#include <cstdint>
#include <vector>

namespace voxelpipe {

// Asks for huge pages where `bytes` bytes from `first` on will be written for the first time. A hint: where the system
// has none, and for small blocks, nothing happens.
inline void PreferHugePages(void* first, uint64_t bytes) {
  constexpr uintptr_t kHugePage = 2 << 20;
  const uintptr_t begin = (reinterpret_cast<uintptr_t>(first) + kHugePage - 1) / kHugePage * kHugePage;
  const uintptr_t end = (reinterpret_cast<uintptr_t>(first) + bytes) / kHugePage * kHugePage;
  if (begin < end) madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
}

// values.reserve(count) on huge pages.
template <typename T>
void ReserveHuge(std::vector<T>& values, uint64_t count) {
  if (count <= values.capacity()) return;
  values.reserve(count);
  PreferHugePages(values.data(), count * sizeof(T));
}

}  // namespace voxelpipe
