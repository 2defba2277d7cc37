// Checks a streamed result and forwards it.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/checksum/sha256.h"
#include "client.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

struct PieceView;

// Receives header, pieces and summary in order. Every error is DATA_LOSS naming the mismatch, except those of the sink.
// After an error the object must not be used.
class ResultReader {
 public:
  // `request` and `sink` must outlive the object. `hashed`: true if the summary must have a SHA-256.
  ResultReader(const VoxelizeRequest& request, uint64_t max_result_bytes, ResultSink& sink, bool hashed = true);
  ~ResultReader();

  // Checks the announced grid and sizes against the request, then begins the sink.
  absl::Status AddHeader(const v1::ResultHeader& message);
  // Checks array, offset, length and CRC-32C, decompresses if needed, then writes the bytes to the sink, in parts and
  // without a copy.
  absl::Status AddPiece(const PieceView& piece);
  absl::Status AddPiece(const v1::ResultPiece& piece);
  // Checks that everything arrived and that its SHA-256 is the announced one.
  absl::Status AddSummary(const v1::Summary& summary);

  // A whole result in one message: the three calls above.
  absl::Status AddWhole(const v1::WholeResult& message);

  // In [0, 1] once the header has arrived.
  double fraction() const { return total_bytes_ == 0 ? 1 : double(received_bytes_) / double(total_bytes_); }

  // The contents of the summary. DATA_LOSS if it has not arrived.
  absl::StatusOr<RemoteRun> Take();

 private:
  absl::Status AddFrame(const PieceView& piece);
  absl::Status AddBytes(std::span<const uint8_t> bytes);
  absl::Status CheckHash(const std::string& announced);

  const VoxelizeRequest& request_;
  const uint64_t max_result_bytes_;
  ResultSink& sink_;
  std::vector<uint64_t> array_bytes_;
  std::vector<uint8_t> raw_;  // of a compressed piece; its memory is reused
  bool has_header_ = false, has_summary_ = false;
  size_t array_ = 0;     // the array of the next byte
  uint64_t offset_ = 0;  // of the next byte in it
  uint64_t received_bytes_ = 0, total_bytes_ = 0;
  std::optional<Sha256> hash_;  // of all bytes, if the summary must have one
  RemoteRun out_;
};

}  // namespace voxelpipe
