// A bounded, process-wide pool of large blocks of host memory.
//
// Why: a fresh 4 KiB page costs about 2 us, so clearing 128 MiB of fresh memory takes ten times as long as clearing the
// same memory again. Consecutive runs use the same sizes, so their blocks are kept for reuse.
#pragma once

#include <cstdint>

namespace voxelpipe {

// Blocks below this size come straight from the allocator.
inline constexpr uint64_t kPooledBytes = 1 << 20;
// Sizes of larger blocks are multiples of this.
inline constexpr uint64_t kPooledUnit = 2 << 20;

// At least `bytes` bytes, 64-byte aligned, contents undefined; nullptr if memory is short. Thread-safe.
void* TakePages(uint64_t bytes);
// Returns a block of TakePages(bytes) to the pool. While idle blocks exceed 1 GiB, or an eighth of the machine's memory
// if that is more, the oldest are freed to the system.
void ReturnPages(void* block, uint64_t bytes);
// The same, but frees the block to the system at once.
void DiscardPages(void* block, uint64_t bytes);
// Frees all idle blocks to the system.
void ReleaseIdlePages();

}  // namespace voxelpipe
