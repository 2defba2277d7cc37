// A span: a row of voxels that one triangle covers within one word of a bit grid, in 8 bytes. No host-only includes.
#pragma once

#include <cstdint>

#include "base/host_device.h"

namespace voxelpipe::cuda {

// Layout from bit 0: bit index of the first voxel in the slab's bit grid (32 bits), length - 1 (5), triangle (27).
inline constexpr uint64_t kNoSpan = ~uint64_t{0};
inline constexpr uint64_t kMaxSpanBits = UINT32_MAX - 31;  // of a bit grid: no span starts in the last words
inline constexpr uint64_t kMaxSpanTriangles = uint64_t{1} << 27;
// Behind the counters (run_state.h): the slab's fragment count, spread over several addresses to reduce contention.
inline constexpr int kFragmentSlots = 64;
// Behind those: fragments of the A-buffer per group of chunks (FragmentCounts).
inline constexpr int kChunkGroups = 256;

VOXELPIPE_HD uint64_t PackSpan(uint32_t first, uint32_t triangle, uint32_t length) {
  return uint64_t{triangle << 5 | (length - 1)} << 32 | first;
}
VOXELPIPE_HD uint32_t SpanFirst(uint64_t span) {
  return uint32_t(span);
}
VOXELPIPE_HD uint32_t SpanWord(uint64_t span) {
  return uint32_t(span) / 32;
}
VOXELPIPE_HD uint32_t SpanLength(uint64_t span) {
  return (uint32_t(span >> 32) & 31) + 1;
}
VOXELPIPE_HD uint32_t SpanTriangle(uint64_t span) {
  return uint32_t(span >> 37);
}
VOXELPIPE_HD uint32_t SpanMask(uint64_t span) {
  return (~0u >> (32 - SpanLength(span))) << (uint32_t(span) % 32);
}

}  // namespace voxelpipe::cuda
