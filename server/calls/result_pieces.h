// The messages of a result, made one at a time in stream order: header, pieces, summary.
#pragma once

#include <cstdint>
#include <span>

#include "pipeline/result.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "work/job.h"
#include "work/sha256.h"

namespace voxelpipe {

// Keeps what the messages of one result share: where the next byte belongs, and the hash. Not thread-safe.
class ResultPieces {
 public:
  static void MakeHeader(const ResultHeader& header, v1::VoxelizeResponse& response);
  // `bytes`, at most kPieceBytes, follow those of the piece before, or begin the next array.
  void MakePiece(size_t array, std::span<const uint8_t> bytes, v1::VoxelizeResponse& response);
  // After the last piece. Call once.
  void MakeSummary(const JobOutcome& outcome, v1::VoxelizeResponse& response);

  uint64_t bytes() const { return bytes_; }  // of all pieces so far

 private:
  size_t array_ = 0;
  uint64_t offset_ = 0, bytes_ = 0;
  Sha256 hash_;
};

}  // namespace voxelpipe
