#include "results/result_sums.h"

#include <algorithm>

#include "base/checksum/crc32c.h"

namespace voxelpipe {

ResultSums::ResultSums(const VoxelizeResult& result, uint64_t piece_bytes) : piece_bytes_(piece_bytes) {
  size_t pieces = 0;
  for (const std::span<const uint8_t> array : ArraysOf(result)) {
    arrays_.push_back({array.size(), pieces});
    pieces += size_t((array.size() + piece_bytes - 1) / piece_bytes);
  }
  sums_ = std::make_unique<std::atomic<uint64_t>[]>(pieces);
  for (size_t i = 0; i < pieces; ++i) sums_[i].store(kUnknown, std::memory_order_relaxed);
}

uint32_t ResultSums::Crc32cOf(size_t array, uint64_t offset, std::span<const uint8_t> bytes) {
  const Array& of = arrays_[array];
  const bool is_piece =
      offset % piece_bytes_ == 0 && offset < of.bytes && bytes.size() == std::min(piece_bytes_, of.bytes - offset);
  if (!is_piece) return Crc32c(bytes);
  // Two threads may compute a sum at the same time: they store the same value.
  std::atomic<uint64_t>& sum = sums_[of.first + size_t(offset / piece_bytes_)];
  uint64_t known = sum.load(std::memory_order_relaxed);
  if (known == kUnknown) {
    known = Crc32c(bytes);
    sum.store(known, std::memory_order_relaxed);
  }
  return uint32_t(known);
}

std::string ResultSums::sha256() const {
  const std::lock_guard lock(mutex_);
  return sha256_;
}

void ResultSums::SetSha256(const std::string& digits) {
  const std::lock_guard lock(mutex_);
  sha256_ = digits;
}

}  // namespace voxelpipe
