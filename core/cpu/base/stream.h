// Streaming stores: writes large arrays past the caches.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace voxelpipe::cpu {

// Arrays up to this size are better left in the caches: they are read again soon.
inline constexpr uint64_t kCachedBytes = 4 << 20;
inline constexpr int64_t kLineBytes = 64;

// An element of 1, 2 or 4 bytes, repeated.
class ElementPattern {
 public:
  // In: the element's low bits. `streams`: whole cache lines go past the caches.
  ElementPattern(uint32_t stored, int element_bytes, bool streams) : streams_(streams) {
    for (int i = 0; i < 16; i += element_bytes)
      std::memcpy(bytes_ + i, &stored, size_t(element_bytes));  // little endian
  }

  // Fills `bytes` bytes; `to` is aligned to the element. After streaming, StreamFence.
  void Fill(uint8_t* to, int64_t bytes) const {
    const int64_t head = std::min(bytes, int64_t(-reinterpret_cast<uintptr_t>(to) & uintptr_t(kLineBytes - 1)));
    const int64_t lines = (bytes - head) / kLineBytes * kLineBytes;
    Put(to, head);
    to += head;
#if defined(__SSE2__)
    if (streams_) {
      const __m128i value = _mm_loadu_si128(reinterpret_cast<const __m128i*>(bytes_));
      for (int64_t at = 0; at < lines; at += 16) _mm_stream_si128(reinterpret_cast<__m128i*>(to + at), value);
      return Put(to + lines, bytes - head - lines);
    }
#endif
    Put(to, bytes - head);
  }

 private:
  void Put(uint8_t* to, int64_t bytes) const {
    int64_t at = 0;
    for (; at + 16 <= bytes; at += 16) std::memcpy(to + at, bytes_, 16);
    if (at < bytes) std::memcpy(to + at, bytes_, size_t(bytes - at));
  }

  bool streams_;
  uint8_t bytes_[16];
};

// Copies `bytes` bytes; past the caches if `streams` and both ends of `to` are at borders of cache lines. After
// streaming, StreamFence.
inline void StreamCopy(uint8_t* to, const void* from, int64_t bytes, bool streams) {
#if defined(__SSE2__)
  if (streams && ((reinterpret_cast<uintptr_t>(to) | uintptr_t(bytes)) & uintptr_t(kLineBytes - 1)) == 0) {
    const auto* source = static_cast<const __m128i*>(from);
    for (int64_t at = 0; at < bytes; at += 16) {
      _mm_stream_si128(reinterpret_cast<__m128i*>(to + at), _mm_loadu_si128(source++));
    }
    return;
  }
#endif
  std::memcpy(to, from, size_t(bytes));
}

// Orders this thread's streaming stores before its later stores.
inline void StreamFence() {
#if defined(__SSE2__)
  _mm_sfence();
#endif
}

}  // namespace voxelpipe::cpu
