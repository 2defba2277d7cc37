// Host memory that this process has allocated, counted by the allocators themselves: malloc and everything based on it,
// and the mappings of the page pool. Linked with -Wl,--wrap=mmap,--wrap=munmap.
#pragma once

#include <cstdint>

namespace voxelpipe::testing {

inline constexpr uint64_t kMiB = 1 << 20;

// False if a sanitizer's allocator replaces the counted one: then nothing is counted.
bool CountsMemory();
// Currently allocated bytes, including idle blocks of the page pool.
uint64_t AllocatedBytes();
// The maximum since the last ResetAllocatedPeak.
uint64_t AllocatedPeak();
void ResetAllocatedPeak();

}  // namespace voxelpipe::testing
