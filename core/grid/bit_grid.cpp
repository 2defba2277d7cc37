#include "grid/bit_grid.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <bit>
#include <cstring>
#include <functional>

namespace voxelpipe {

absl::StatusOr<BitGrid> BitGrid::CreateUncleared(const std::array<int64_t, 3>& dims) {
  BitGrid grid;
  grid.dims_ = dims;
  grid.words_per_row_ = (dims[0] + 31) / 32;
  absl::StatusOr<HostBuffer> words = HostBuffer::Allocate(BytesFor(dims));
  if (!words.ok()) return words.status();
  grid.words_ = *std::move(words);
  return grid;
}

absl::StatusOr<BitGrid> BitGrid::Create(const std::array<int64_t, 3>& dims) {
  absl::StatusOr<BitGrid> created = CreateUncleared(dims);
  if (!created.ok()) return created.status();
  BitGrid grid = *std::move(created);
  // Parallel so that the first touch of the pages is shared among the threads.
  constexpr uint64_t kBlock = 1 << 20;
  const uint64_t bytes = grid.words_.size();
  tbb::parallel_for(uint64_t{0}, (bytes + kBlock - 1) / kBlock, [&](uint64_t b) {
    std::memset(grid.words_.data() + b * kBlock, 0, std::min(kBlock, bytes - b * kBlock));
  });
  return grid;
}

uint64_t CountBits(const BitGrid& grid) {
  return CountUnion(grid, grid);
}

uint64_t CountUnion(std::span<const uint32_t> a, std::span<const uint32_t> b) {
  uint64_t count = 0;
  size_t w = 0;
  for (; w + 2 <= a.size(); w += 2) {  // two words at a time take half of the time
    uint64_t pair_a = 0, pair_b = 0;
    std::memcpy(&pair_a, &a[w], sizeof pair_a);
    std::memcpy(&pair_b, &b[w], sizeof pair_b);
    count += uint64_t(std::popcount(pair_a | pair_b));
  }
  if (w < a.size()) count += uint64_t(std::popcount(a[w] | b[w]));
  return count;
}

uint64_t CountUnion(const BitGrid& a, const BitGrid& b) {
  return tbb::parallel_reduce(
      tbb::blocked_range<int64_t>(0, a.rows(), 256), uint64_t{0},
      [&](const tbb::blocked_range<int64_t>& range, uint64_t count) {
        const auto words = size_t((range.end() - range.begin()) * a.words_per_row());
        return count + CountUnion({a.row(range.begin()).data(), words}, {b.row(range.begin()).data(), words});
      },
      std::plus<>());
}

}  // namespace voxelpipe
