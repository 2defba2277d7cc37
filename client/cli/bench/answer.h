// The result of one call or of one job of a batch, read for its figures: result bytes are checked and counted in place,
// without a copy.
#pragma once

#include <cstdint>
#include <string>

#include <grpcpp/support/byte_buffer.h>

#include "absl/status/status.h"
#include "bench/load.h"
#include "reply/piece_view.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe::cli {

class Answer {
 public:
  void Reset() { *this = Answer(); }

  // The next message of the call. DATA_LOSS if it cannot be parsed, or a piece does not match its CRC-32C. Consumes the
  // buffer.
  absl::Status Take(grpc::ByteBuffer& buffer);
  absl::Status Take(v1::VoxelizeResponse& message);

  // Counts a message that was not passed to Take(buffer).
  void CountReceived(uint64_t bytes) { received_bytes_ += bytes; }

  bool complete() const { return complete_; }  // the summary has arrived
  uint64_t bytes() const { return bytes_; }    // of the result, uncompressed
  const v1::Summary& summary() const { return summary_; }

  // Writes the figures of the response to `outcome`. Its code is DATA_LOSS unless the response is complete, has the
  // announced length and, unless `expected_hash` is empty, that hash. (The server's hash is compared, not computed,
  // which would cost more than the load.)
  void Fill(const std::string& expected_hash, Outcome& outcome) const;

 private:
  absl::Status Take(const PieceView& piece);

  PieceViewer viewer_;
  v1::Summary summary_;
  uint64_t bytes_ = 0, received_bytes_ = 0;
  bool complete_ = false;
};

}  // namespace voxelpipe::cli
