// Host memory that this process has allocated, counted by the allocators themselves: malloc and what stands on it, and
// the mappings of the page pool. Linked with -Wl,--wrap=mmap,--wrap=munmap.
#pragma once

#include <cstdint>

namespace voxelpipe::testing {

// False where a sanitizer's allocator is in the place of the counted one: then nothing is counted.
bool CountsMemory();
// Bytes that are allocated now; blocks that the page pool keeps idle count.
uint64_t AllocatedBytes();
// The most since the last ResetAllocatedPeak.
uint64_t AllocatedPeak();
void ResetAllocatedPeak();

}  // namespace voxelpipe::testing
