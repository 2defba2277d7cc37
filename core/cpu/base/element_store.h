// Writing single elements of packed arrays.
#pragma once

#include <atomic>
#include <cstdint>
#include <cstring>

namespace voxelpipe::cpu {

// Writes element `at` of an array of elements of `bits` bits (1, 8, 16 or 32; little endian). A bit is only ever set:
// its array starts cleared, and several threads may set bits of one byte.
inline void PutElement(uint8_t* array, int bits, uint64_t at, uint32_t stored) {
  if (bits != 1) {
    std::memcpy(array + at * uint64_t(bits / 8), &stored, size_t(bits / 8));
  } else if (stored != 0) {
    std::atomic_ref<uint8_t>(array[at / 8]).fetch_or(uint8_t(1u << (at % 8)), std::memory_order_relaxed);
  }
}

}  // namespace voxelpipe::cpu
