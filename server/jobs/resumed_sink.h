// A result that is made twice is delivered once.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "job/result.h"

namespace voxelpipe {

// Between a job's runs and where its streamed result goes. A run that fails in the middle has handed bytes on that
// cannot be taken back; the next run makes the same bytes again, whatever the device (results are deterministic), so
// those that went out already are dropped and the rest follows. The header must be the same, or the run ends with
// INTERNAL. One run at a time.
class ResumedSink final : public ResultSink {
 public:
  // `out` must outlive the runs; it receives one Begin, and every byte once.
  void SetOut(ResultSink& out) { out_ = &out; }
  // True if anything was handed on: the next run must stream, too.
  bool begun() const { return header_.has_value(); }

  absl::Status Begin(const ResultHeader& header) override;
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override;

 private:
  // A place in the stream.
  struct Place {
    size_t array = 0;
    uint64_t offset = 0;
  };

  ResultSink* out_ = nullptr;
  std::optional<ResultHeader> header_;
  Place delivered_;  // everything before it was handed on
  Place made_;       // by this run
};

}  // namespace voxelpipe
