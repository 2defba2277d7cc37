// Implementation of PackBits (bit_grid.h).
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>

#include "grid/bit_grid.h"

namespace voxelpipe {

template <typename WordAt>
void PackBits(const std::array<int64_t, 3>& dims, std::span<uint8_t> out, WordAt word) {
  const int64_t nx = dims[0], rows = dims[1] * dims[2], words = (nx + 31) / 32;
  // A multiple of 8 rows starts on a byte boundary for every nx, so blocks of rows never share a byte.
  const int64_t rows_per_block = std::max<int64_t>(8, ((1 << 16) / nx + 7) / 8 * 8);
  const int64_t blocks = (rows + rows_per_block - 1) / rows_per_block;
  tbb::parallel_for(int64_t{0}, blocks, [&](int64_t block) {
    const int64_t first = block * rows_per_block, last = std::min(rows, first + rows_per_block);
    uint8_t* byte = out.data() + first * nx / 8;
    if (nx % 32 == 0) {  // rows fill their words, which are already packed (little endian)
      for (int64_t r = first; r < last; ++r) {
        for (int64_t w = 0; w < words; ++w, byte += 4) {
          const uint32_t bits = word(r, w);
          std::memcpy(byte, &bits, sizeof bits);
        }
      }
      return;
    }
    uint64_t pending = 0;
    int pending_bits = 0;  // below 32 between words
    for (int64_t r = first; r < last; ++r) {
      for (int64_t w = 0; w < words; ++w) {
        const int bits = int(std::min<int64_t>(32, nx - w * 32));
        pending |= uint64_t(word(r, w)) << pending_bits;
        pending_bits += bits;
        if (pending_bits < 32) continue;
        const auto full = uint32_t(pending);
        std::memcpy(byte, &full, sizeof full);
        byte += sizeof full;
        pending >>= 32;
        pending_bits -= 32;
      }
    }
    for (; pending_bits > 0; pending_bits -= 8, pending >>= 8) *byte++ = uint8_t(pending);
  });
}

}  // namespace voxelpipe
