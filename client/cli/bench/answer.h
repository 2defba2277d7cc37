// One answer of a Voxelize or VoxelizeMany call, read for its figures: result bytes are checked and counted where they
// lie, and not copied.
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

  // The next message of the call. DATA_LOSS where it cannot be read, or a piece is not what its CRC-32C says. The
  // buffer is used up.
  absl::Status Take(grpc::ByteBuffer& buffer);
  absl::Status Take(v1::VoxelizeResponse& message);
  // Takes the summary out of it.
  absl::Status Take(v1::WholeResult& whole);

  // Counts a message that came some other way than Take(buffer).
  void CountReceived(uint64_t bytes) { received_bytes_ += bytes; }

  bool complete() const { return complete_; }  // the summary is there
  uint64_t bytes() const { return bytes_; }    // of the result, uncompressed
  const v1::Summary& summary() const { return summary_; }

  // Writes what the answer says into `outcome`: its code is DATA_LOSS unless it is complete, as long as announced and,
  // unless `expected_hash` is empty, of that hash. (The server's hash is compared, not computed: that would cost more
  // than the load.)
  void Fill(const std::string& expected_hash, Outcome& outcome) const;

 private:
  absl::Status Take(const PieceView& piece);
  void Take(v1::Summary& summary);

  PieceViewer viewer_;
  v1::Summary summary_;
  uint64_t bytes_ = 0, received_bytes_ = 0;
  bool complete_ = false;
};

}  // namespace voxelpipe::cli
