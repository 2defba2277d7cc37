// Large arrays on huge pages: one page fault instead of 512 of 1 to 2 us each.
#pragma once

#include <sys/mman.h>

#include <cstdint>
#include <vector>

namespace voxelpipe {

// Requests huge pages for `bytes` bytes from `first` on, before they are written for the first time. A hint: no effect
// for small blocks, or if the system has none.
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
