// One bit a voxel, rows padded to 32-bit words: the form in which stages use bits. Results are packed (PackBits).
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "absl/status/statusor.h"
#include "grid/host_buffer.h"

namespace voxelpipe {

// Bit i of row (j,k) is bit i%32 of word i/32 of that row. Padding bits are 0. A tile is 32 voxels wide, so every word
// belongs to one tile and tiles are written without atomics.
class BitGrid {
 public:
  BitGrid() = default;

  // All bits clear. RESOURCE_EXHAUSTED if memory is short.
  static absl::StatusOr<BitGrid> Create(const std::array<int64_t, 3>& dims);
  // Contents undefined: the caller must write every word.
  static absl::StatusOr<BitGrid> CreateUncleared(const std::array<int64_t, 3>& dims);

  // The words themselves in the format of kBit. Only if dims[0] % 32 == 0: rows that fill their words are already
  // packed.
  HostBuffer TakePacked() { return std::move(words_); }

  bool empty() const { return words_.size() == 0; }
  int64_t words_per_row() const { return words_per_row_; }
  int64_t rows() const { return dims_[1] * dims_[2]; }
  // Row number j + ny*k.
  std::span<uint32_t> row(int64_t r) { return {data() + r * words_per_row_, size_t(words_per_row_)}; }
  std::span<const uint32_t> row(int64_t r) const { return {data() + r * words_per_row_, size_t(words_per_row_)}; }

  // The bits of a row's last word that are voxels.
  uint32_t last_word_mask() const { return dims_[0] % 32 == 0 ? ~0u : (1u << (dims_[0] % 32)) - 1; }

  static uint64_t BytesFor(const std::array<int64_t, 3>& dims) {
    return uint64_t((dims[0] + 31) / 32) * uint64_t(dims[1]) * uint64_t(dims[2]) * sizeof(uint32_t);
  }

 private:
  uint32_t* data() { return reinterpret_cast<uint32_t*>(words_.data()); }
  const uint32_t* data() const { return reinterpret_cast<const uint32_t*>(words_.data()); }

  std::array<int64_t, 3> dims_{};
  int64_t words_per_row_ = 0;
  HostBuffer words_;
};

// Number of set bits. Parallel, deterministic.
uint64_t CountBits(const BitGrid& grid);

// Number of bits set in at least one of two grids of the same dims.
uint64_t CountUnion(const BitGrid& a, const BitGrid& b);
// The same for two runs of rows of the same size.
uint64_t CountUnion(std::span<const uint32_t> a, std::span<const uint32_t> b);

// In: a callback that returns word w of row r. Out: the packed bits of the linear order, no row padding, bit n in byte
// n/8 at n%8, unused bits of the last byte 0. `out` holds ceil(voxels/8) bytes. Parallel over rows; `word` must be safe
// to call concurrently and return 0 in padding bits.
template <typename WordAt>
void PackBits(const std::array<int64_t, 3>& dims, std::span<uint8_t> out, WordAt word);

}  // namespace voxelpipe

#include "grid/bit_grid_pack.h"
