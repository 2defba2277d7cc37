// The messages of a result, made one at a time in stream order: header, pieces, summary; or all in one.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <grpcpp/support/byte_buffer.h>

#include "base/checksum/sha256.h"
#include "job/result.h"
#include "jobs/job.h"
#include "pipeline/plan/plan.h"
#include "reply/response_coder.h"
#include "reply/zstd_piece.h"
#include "results/result_sums.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "wire/call_settings.h"

namespace voxelpipe {

// A result of at most so many bytes goes into one message where the client can take that.
inline constexpr uint64_t kWholeBytes = 1 << 20;

struct PieceOptions {
  uint64_t piece_bytes = 1 << 20;  // of the result in one piece
  int zstd_level = 1;
};

// Keeps what the messages of one result share: where the next byte belongs, and the hash. Not thread-safe.
class ResultPieces {
 public:
  ResultPieces(const CallSettings& settings, const PieceOptions& options, ResponseCoder coder = {});

  grpc::ByteBuffer Header(const ResultHeader& header) const;
  // `bytes` follow those of the piece before, or begin the next array. `owner` keeps them; null: they are copied.
  grpc::ByteBuffer Piece(size_t array, std::span<const uint8_t> bytes, std::shared_ptr<const void> owner);
  // Every piece's bytes in order, apart from Piece so that hashing goes on while they are sent. Not needed where the
  // hash is known.
  void Hash(std::span<const uint8_t> bytes);
  // Of a result that others read, too: its checksums are taken from `sums`, and left there. null: they are of this
  // stream alone.
  void SetShared(bool cached, std::shared_ptr<ResultSums> sums);
  // After the last piece. Call once.
  grpc::ByteBuffer Summary(const JobOutcome& outcome);

  // All of a small result. Call alone, once. `outcome` stays until gRPC has sent the message.
  grpc::ByteBuffer Whole(const Plan& plan, const std::shared_ptr<const JobOutcome>& outcome);

  // Pieces are made without compressing or hashing them.
  bool at_once() const { return !compressor_ && (!hashed_ || !known_hash_.empty()); }
  uint64_t piece_bytes() const { return options_.piece_bytes; }
  uint64_t bytes() const { return bytes_; }            // of all pieces so far
  uint64_t sent_bytes() const { return sent_bytes_; }  // of the same, as they are sent

 private:
  CodedPiece Code(size_t array, std::span<const uint8_t> bytes, std::shared_ptr<const void> owner);
  void MakeSummary(const JobOutcome& outcome, v1::Summary& summary);

  const PieceOptions options_;
  const bool hashed_;
  const ResponseCoder coder_;
  std::optional<PieceCompressor> compressor_;
  size_t array_ = 0;
  uint64_t offset_ = 0, bytes_ = 0, sent_bytes_ = 0;
  std::optional<Sha256> hash_;  // made when it is needed
  std::shared_ptr<ResultSums> sums_;
  std::string known_hash_;
  bool cached_ = false;
};

// Of all arrays together.
uint64_t ResultBytes(const VoxelizeResult& result);

}  // namespace voxelpipe
