// A bounded, process-wide pool of large blocks of host memory.
//
// Why: a fresh 4 KiB page costs about 2 us, so clearing 128 MiB of fresh memory takes ten times as long as clearing the
// same memory again. Runs follow each other with the same sizes, so their blocks are kept and handed out again.
#pragma once

#include <cstdint>

namespace voxelpipe {

// Blocks below this size come straight from the allocator.
inline constexpr uint64_t kPooledBytes = 1 << 20;
// Larger ones take a multiple of it.
inline constexpr uint64_t kPooledUnit = 2 << 20;

// At least `bytes` bytes, 64-byte aligned, contents undefined; nullptr when the system has none. Thread-safe.
void* TakePages(uint64_t bytes);
// Gives a block of TakePages(bytes) back. Idle blocks of more than 1 GiB together, or an eighth of the machine's
// memory where that is more, go to the system, the oldest first.
void ReturnPages(void* block, uint64_t bytes);
// The same, but to the system at once.
void DiscardPages(void* block, uint64_t bytes);
// Gives all idle blocks to the system.
void ReleaseIdlePages();

}  // namespace voxelpipe
