// The messages of a result, made one at a time in stream order: header, pieces, summary; or one message.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <grpcpp/support/byte_buffer.h>

#include "base/checksum/sha256.h"
#include "job/request.h"
#include "job/result.h"
#include "jobs/job.h"
#include "pipeline/plan/plan.h"
#include "reply/response_coder.h"
#include "reply/zstd_piece.h"
#include "results/result_sums.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "wire/call_settings.h"

namespace voxelpipe {

// True if a result of `result_bytes` is sent in one message.
bool FitsOneMessage(uint64_t result_bytes, const CallSettings& settings);

struct PieceOptions {
  uint64_t piece_bytes = 1 << 20;  // of the result in one piece
  int zstd_level = 1;
};

// The state of the messages of one result: the position of the next byte, and the hash. Not thread-safe.
class ResultPieces {
 public:
  // `request` lives as long as this object.
  ResultPieces(const VoxelizeRequest& request, const CallSettings& settings, const PieceOptions& options,
               ResponseCoder coder = {});

  // `plan`: sent in the same message, unless null.
  grpc::ByteBuffer Header(const ResultHeader& header, const Plan* plan = nullptr) const;
  // `bytes` follow those of the previous piece, or begin the next array. `owner` keeps them alive; null: they are
  // copied.
  grpc::ByteBuffer Piece(size_t array, std::span<const uint8_t> bytes, std::shared_ptr<const void> owner);
  // Hashes every piece's bytes in order; separate from Piece, so that hashing overlaps with sending. Not needed if the
  // hash is known.
  void Hash(std::span<const uint8_t> bytes);
  // Reads and stores the checksums of a shared result in `sums`. Null: the result is not shared.
  void SetShared(bool cached, std::shared_ptr<ResultSums> sums);
  // After the last piece. Call once.
  grpc::ByteBuffer Summary(const JobOutcome& outcome);

  // A whole small result in one message, with the plan unless it is null. Call only this, once. `outcome` lives until
  // gRPC has sent the message.
  grpc::ByteBuffer Whole(const Plan* plan, const std::shared_ptr<const JobOutcome>& outcome);

  // True if pieces are neither compressed nor hashed.
  bool at_once() const { return !compressor_ && (!hashed_ || !known_hash_.empty()); }
  uint64_t piece_bytes() const { return options_.piece_bytes; }
  uint64_t bytes() const { return bytes_; }            // of all pieces so far
  uint64_t sent_bytes() const { return sent_bytes_; }  // of the same, as sent

 private:
  CodedPiece Code(size_t array, std::span<const uint8_t> bytes, std::shared_ptr<const void> owner);
  void MakeSummary(const JobOutcome& outcome, v1::Summary& summary);

  const VoxelizeRequest& request_;
  const PieceOptions options_;
  const bool hashed_;
  const ResponseCoder coder_;
  std::optional<PieceCompressor> compressor_;
  size_t array_ = 0;
  uint64_t offset_ = 0, bytes_ = 0, sent_bytes_ = 0;
  std::optional<Sha256> hash_;  // created on demand
  std::shared_ptr<ResultSums> sums_;
  std::string known_hash_;
  bool cached_ = false;
};

// What a summary says of the job: all but sizes, hash and the cache.
void WriteOutcome(const JobOutcome& outcome, v1::Summary& summary);

// Of all arrays together.
uint64_t ResultBytes(const VoxelizeResult& result);

}  // namespace voxelpipe
