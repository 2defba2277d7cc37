// A sink between runs and the caller's sink, for runs that may fail in the middle and be repeated.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "job/result.h"

namespace voxelpipe {

// A run that fails in the middle has delivered bytes that cannot be recalled. The next run makes the same bytes in the
// same order on every device (results are deterministic): this drops the bytes already delivered, so that the caller's
// sink gets one Begin and every byte once. Each run starts with Begin, with the header of the first run; otherwise it
// ends with INTERNAL. One run at a time.
class ResumingSink final : public ResultSink {
 public:
  ResumingSink() = default;  // SetOut comes before the first run
  // `out` must outlive the runs.
  explicit ResumingSink(ResultSink& out) : out_(&out) {}
  void SetOut(ResultSink& out) { out_ = &out; }

  // True if anything was delivered: the next run must stream too.
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
  Position delivered_;  // everything before it was delivered
  Position made_;       // of this run
};

}  // namespace voxelpipe
