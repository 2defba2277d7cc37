// Checksums of a shared result, computed once.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "job/result.h"

namespace voxelpipe {

// Each is computed by its first user. Thread-safe.
class ResultSums {
 public:
  // For a result with arrays of the same sizes as `result`, in pieces of `piece_bytes`.
  ResultSums(const VoxelizeResult& result, uint64_t piece_bytes);

  // CRC-32C of `bytes`, those of the array from `offset` on. Stored if they are a whole piece, or an array's last one.
  uint32_t Crc32cOf(size_t array, uint64_t offset, std::span<const uint8_t> bytes);

  // SHA-256 of the arrays in stream order, 64 hexadecimal digits. Empty until it was set.
  std::string sha256() const;
  void SetSha256(const std::string& digits);

 private:
  struct Array {
    uint64_t bytes = 0;
    size_t first = 0;  // of its pieces in sums_
  };
  static constexpr uint64_t kUnknown = ~uint64_t{0};

  const uint64_t piece_bytes_;
  std::vector<Array> arrays_;
  std::unique_ptr<std::atomic<uint64_t>[]> sums_;
  mutable std::mutex mutex_;
  std::string sha256_;
};

}  // namespace voxelpipe
