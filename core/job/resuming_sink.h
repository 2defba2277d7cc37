// A sink between a run and the caller's, for runs that may end early and be done again by another device.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "job/result.h"

namespace voxelpipe {

// Hands on what no earlier run has handed on: all runs of a request give the same bytes in the same order. The caller's sink, which must outlive it,
// hears of one run.
class ResumingSink final : public ResultSink {
 public:
  explicit ResumingSink(ResultSink& to) : to_(to) {}

  // What comes next is from the start again.
  void Restart() { at_.clear(); }

  bool Keep(VoxelizeResult&& whole) override;
  absl::Status Begin(const ResultHeader& header) override;
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override;

 private:
  ResultSink& to_;
  bool begun_ = false;
  std::vector<uint64_t> at_, done_;  // bytes of each array: of this run, and those that were handed on
};

}  // namespace voxelpipe
