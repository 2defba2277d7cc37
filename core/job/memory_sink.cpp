#include "job/memory_sink.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace voxelpipe {

absl::Status MemorySink::Begin(const ResultHeader& header) {
  absl::StatusOr<VoxelizeResult> result = AllocateResult(header);
  if (!result.ok()) return result.status();
  result_ = *std::move(result);
  arrays_ = header.arrays;
  return absl::OkStatus();
}

absl::Status MemorySink::Write(size_t array, std::span<const uint8_t> bytes) {
  if (array != std::exchange(array_, array)) offset_ = 0;
  const std::vector<std::span<uint8_t>> arrays = MutableArraysOf(result_);
  if (array >= arrays.size() || bytes.size() > arrays[array].size() - offset_) {
    return absl::InternalError("more bytes than the result has");
  }
  std::copy(bytes.begin(), bytes.end(), arrays[array].data() + offset_);
  offset_ += bytes.size();
  return absl::OkStatus();
}

}  // namespace voxelpipe
