// Collects a streamed result in memory.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "job/result.h"

namespace voxelpipe {

class MemorySink final : public ResultSink {
 public:
  // RESOURCE_EXHAUSTED if there is no memory for the arrays.
  absl::Status Begin(const ResultHeader& header) override;
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override;

  // The collected result. Call once, last.
  VoxelizeResult Take() { return std::move(result_); }
  // From Begin.
  const std::vector<ArraySpec>& arrays() const { return arrays_; }

 private:
  VoxelizeResult result_;
  std::vector<ArraySpec> arrays_;
  size_t array_ = 0;     // the array being written
  uint64_t offset_ = 0;  // of the next byte in it
};

}  // namespace voxelpipe
