// Checks a streamed result and forwards it.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <grpcpp/support/byte_buffer.h>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/checksum/sha256.h"
#include "client.h"
#include "reply/piece_view.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// What a reader reports while the messages come.
struct ReaderEvents {
  std::function<void(const Plan&)> on_plan = {};
  std::function<void(const std::string& stage, double fraction)> on_progress = {};  // the server's, and "download"
};

// Receives the messages of one call, or of one job of a batch. Every error is DATA_LOSS naming the mismatch, except
// those of the sink. After an error the object must not be used.
class ResultReader {
 public:
  // `request` and `sink` must outlive the object. `hashed`: true if the summary must have a SHA-256.
  ResultReader(const VoxelizeRequest& request, uint64_t max_result_bytes, ResultSink& sink, bool hashed = true,
               ReaderEvents events = {});
  ~ResultReader();

  // The next message, whatever parts of a result it has. The header: checks the announced grid and sizes against the
  // request, then begins the sink. A piece: checks array, offset, length and CRC-32C, decompresses if needed, then
  // writes the bytes to the sink. The summary: checks that everything arrived and has the announced SHA-256.
  absl::Status Add(const v1::VoxelizeResponse& message);
  // The same as it was received. The bytes of a message of pieces alone go to the sink in parts and without a copy.
  absl::Status Add(grpc::ByteBuffer& message);

  // The contents of the summary. DATA_LOSS if it has not arrived.
  absl::StatusOr<RemoteRun> Take();

 private:
  absl::Status AddPlan(const v1::VoxelizationPlan& message);
  absl::Status AddProgress(const v1::Progress& message);
  absl::Status AddHeader(const v1::ResultHeader& message);
  absl::Status AddPieces(std::span<const PieceView> pieces);
  absl::Status AddPiece(const PieceView& piece);
  absl::Status AddFrame(const PieceView& piece);
  absl::Status AddBytes(std::span<const uint8_t> bytes);
  absl::Status AddSummary(const v1::Summary& summary);
  absl::Status CheckHash(const std::string& announced);
  void ReportDownload() const;

  const VoxelizeRequest& request_;
  const uint64_t max_result_bytes_;
  ResultSink& sink_;
  const ReaderEvents events_;
  PieceViewer viewer_;
  std::vector<uint64_t> array_bytes_;
  std::vector<uint8_t> raw_;  // of a compressed piece; its memory is reused
  bool has_plan_ = false, has_header_ = false, has_summary_ = false;
  size_t array_ = 0;     // the array of the next byte
  uint64_t offset_ = 0;  // of the next byte in it
  uint64_t received_bytes_ = 0, total_bytes_ = 0;
  std::optional<Sha256> hash_;  // of all bytes, if the summary must have one
  RemoteRun out_;
};

}  // namespace voxelpipe
