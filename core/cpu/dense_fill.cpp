#include "cpu/dense_fill.h"

#include <algorithm>
#include <bit>
#include <cstring>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include "cpu/parallel.h"

namespace voxelpipe::cpu {
namespace {

constexpr int64_t kChunkBytes = 1 << 20;
constexpr uint64_t kCachedBytes = 4 << 20;  // what is read again soon should stay in the caches

// `bytes` bytes of a repeated 16-byte pattern, to a 16-byte boundary.
void StreamPattern(uint8_t* to, int64_t bytes, const uint8_t (&pattern)[16]) {
  int64_t at = 0;
#if defined(__SSE2__)
  const __m128i value = _mm_loadu_si128(reinterpret_cast<const __m128i*>(pattern));
  for (; at + 16 <= bytes; at += 16) _mm_stream_si128(reinterpret_cast<__m128i*>(to + at), value);
  _mm_sfence();
#endif
  for (; at < bytes; ++at) to[at] = pattern[at % 16];
}

template <typename Element>
void FillElements(RunState& state, CpuTarget& target, int64_t row, std::span<const uint32_t> inside) {
  auto* const out = reinterpret_cast<Element*>(target.dense.data());
  const bool planar = state.request.request.layout == Layout::kPlanar;
  const uint64_t components = uint64_t(target.spec.components), voxels = state.slab_voxels();
  for (size_t w = 0; w < inside.size(); ++w) {
    const uint32_t present = target.own_presence ? target.presence.row(row)[w] : state.coverage.row(row)[w];
    for (uint32_t left = inside[w] & ~present; left != 0; left &= left - 1) {
      const uint64_t n = uint64_t(row) * uint64_t(state.dims[0]) + w * 32 + uint64_t(std::countr_zero(left));
      for (uint64_t c = 0; c < components; ++c) {
        out[planar ? c * voxels + n : n * components + c] = Element(target.fill_stored);
      }
    }
  }
}

}  // namespace

absl::Status ClearElements(HostBuffer& buffer, uint32_t stored, int element_bytes, const JobContext& job) {
  uint8_t pattern[16];
  for (int i = 0; i < 16; i += element_bytes)
    std::memcpy(pattern + i, &stored, size_t(element_bytes));  // little endian
  const auto bytes = int64_t(buffer.size());
  return ParallelChunks((bytes + kChunkBytes - 1) / kChunkBytes, 1, job, [&](int64_t begin, int64_t end) {
    for (int64_t chunk = begin; chunk < end; ++chunk) {
      uint8_t* const to = buffer.data() + chunk * kChunkBytes;
      const int64_t count = std::min(kChunkBytes, bytes - chunk * kChunkBytes);
      if (buffer.size() > kCachedBytes) {
        StreamPattern(to, count, pattern);
      } else {
        for (int64_t at = 0; at < count; at += 16)
          std::memcpy(to + at, pattern, size_t(std::min<int64_t>(16, count - at)));
      }
    }
  });
}

void FillRow(RunState& state, CpuTarget& target, int64_t row, std::span<const uint32_t> inside) {
  switch (BitsPerComponent(target.spec.format)) {
    case 8: return FillElements<uint8_t>(state, target, row, inside);
    case 16: return FillElements<uint16_t>(state, target, row, inside);
    case 32: return FillElements<uint32_t>(state, target, row, inside);
    default: return;
  }
}

}  // namespace voxelpipe::cpu
