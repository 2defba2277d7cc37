// A sink between runs and the caller's sink, for runs that may fail in the middle and be done again.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "job/result.h"

namespace voxelpipe {

// A run that fails in the middle has handed on bytes that cannot be taken back. The next run makes the same bytes in
// the same order, whatever the device (results are deterministic): those that were handed on already are dropped, and
// the caller's sink gets one Begin and every byte once. A run begins anew with Begin; its header must be that of the
// first, or it ends with INTERNAL. One run at a time.
class ResumingSink final : public ResultSink {
 public:
  ResumingSink() = default;  // SetOut comes before the first run
  // `out` must outlive the runs.
  explicit ResumingSink(ResultSink& out) : out_(&out) {}
  void SetOut(ResultSink& out) { out_ = &out; }

  // True if anything was handed on: the next run must stream, too.
  bool begun() const { return header_.has_value(); }

  bool Keep(VoxelizeResult&& whole) override;
  absl::Status Begin(const ResultHeader& header) override;
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override;

 private:
  // A position in the stream.
  struct Position {
    size_t array = 0;
    uint64_t offset = 0;
  };

  ResultSink* out_ = nullptr;
  std::optional<ResultHeader> header_;
  Position delivered_;  // everything before it was handed on
  Position made_;       // by this run
};

}  // namespace voxelpipe
