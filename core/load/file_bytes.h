// The bytes of a file that is read as a whole.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <utility>
#include <vector>

#include "base/huge_pages.h"

namespace voxelpipe {

// For large arrays that are written once, right after allocation: resize() leaves new elements uninitialized, and large
// blocks use huge pages.
template <typename T>
class BulkAllocator {
 public:
  using value_type = T;
  BulkAllocator() = default;
  template <typename U>
  BulkAllocator(const BulkAllocator<U>&) {}  // NOLINT(google-explicit-constructor): required of allocators

  T* allocate(size_t count) {
    T* const block = std::allocator<T>().allocate(count);
    PreferHugePages(block, count * sizeof(T));
    return block;
  }
  void deallocate(T* block, size_t count) { std::allocator<T>().deallocate(block, count); }
  template <typename U, typename... Arguments>
  void construct(U* at, Arguments&&... arguments) {
    if constexpr (sizeof...(Arguments) == 0) {
      ::new (static_cast<void*>(at)) U;
    } else {
      ::new (static_cast<void*>(at)) U(std::forward<Arguments>(arguments)...);
    }
  }
  friend bool operator==(const BulkAllocator&, const BulkAllocator&) { return true; }
};

using FileBytes = std::vector<uint8_t, BulkAllocator<uint8_t>>;

}  // namespace voxelpipe
