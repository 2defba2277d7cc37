#include "job/resuming_sink.h"

#include <algorithm>
#include <utility>

namespace voxelpipe {

bool ResumingSink::Keep(VoxelizeResult&& whole) {
  return !begun_ && to_.Keep(std::move(whole));
}

absl::Status ResumingSink::Begin(const ResultHeader& header) {
  if (std::exchange(begun_, true)) return absl::OkStatus();
  return to_.Begin(header);
}

absl::Status ResumingSink::Write(size_t array, std::span<const uint8_t> bytes) {
  at_.resize(std::max(at_.size(), array + 1));
  done_.resize(std::max(done_.size(), array + 1));
  const uint64_t begin = std::exchange(at_[array], at_[array] + bytes.size());
  const uint64_t known = std::min<uint64_t>(done_[array] - std::min(done_[array], begin), bytes.size());
  if (known == bytes.size()) return absl::OkStatus();
  done_[array] = at_[array];
  return to_.Write(array, bytes.subspan(known));
}

}  // namespace voxelpipe
