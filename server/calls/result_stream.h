// The messages of one finished job whose result stands in memory, made one at a time.
#pragma once

#include <cstdint>

#include "calls/result_pieces.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "work/job.h"

namespace voxelpipe {

class ResultStream {
 public:
  explicit ResultStream(JobOutcome outcome) : outcome_(std::move(outcome)) {}

  // Fills `response` with the next message; false when the summary has been made already.
  bool Next(v1::VoxelizeResponse& response);

  uint64_t bytes_sent() const { return pieces_.bytes(); }
  const JobOutcome& outcome() const { return outcome_; }

 private:
  enum class Part { kHeader, kPieces, kSummary, kEnd };

  bool NextPiece(v1::VoxelizeResponse& response);

  JobOutcome outcome_;
  Part part_ = Part::kHeader;
  size_t array_ = 0;
  uint64_t offset_ = 0;
  ResultPieces pieces_;
};

}  // namespace voxelpipe
