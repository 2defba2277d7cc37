// The messages of a finished job with its result in memory, made one at a time.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include <grpcpp/support/byte_buffer.h>

#include "jobs/job.h"
#include "reply/result_pieces.h"

namespace voxelpipe {

// Not thread-safe. Messages keep the outcome alive until gRPC has sent them, also after the end of this object.
class ResultStream {
 public:
  // `cached`: for the summary.
  ResultStream(std::shared_ptr<const JobOutcome> outcome, const CallSettings& settings, const PieceOptions& options,
               ResponseCoder coder = {}, bool cached = false);

  // The next message. Not after the last one, the summary.
  grpc::ByteBuffer Next();
  // Work that can overlap with sending the message of Next. Call after each Next.
  void CatchUp();
  bool done() const { return part_ == Part::kEnd; }
  // True if there is a next message and neither CatchUp nor Next have much work for it: it follows immediately.
  bool next_is_ready() const { return !done() && pieces_.at_once(); }

  uint64_t bytes() const { return pieces_.bytes(); }
  uint64_t sent_bytes() const { return pieces_.sent_bytes(); }
  const JobOutcome& outcome() const { return *outcome_; }

 private:
  enum class Part { kHeader, kPieces, kEnd };

  const std::shared_ptr<const JobOutcome> outcome_;
  const std::vector<std::span<const uint8_t>> arrays_;
  Part part_ = Part::kHeader;
  size_t array_ = 0;
  uint64_t offset_ = 0;
  std::span<const uint8_t> to_hash_;
  ResultPieces pieces_;
};

}  // namespace voxelpipe
