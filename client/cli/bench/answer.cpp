#include "bench/answer.h"

#include <grpcpp/impl/codegen/proto_utils.h>

#include "wire/count.h"
#include "wire/duration.h"

namespace voxelpipe::cli {
namespace {

uint64_t Nanoseconds(double milliseconds) {
  return milliseconds > 0 ? uint64_t(milliseconds * 1e6) : 0;
}

}  // namespace

absl::Status Answer::Take(grpc::ByteBuffer& buffer) {
  received_bytes_ += buffer.Length();
  if (const std::span<const PieceView> pieces = viewer_.View(buffer); !pieces.empty()) {
    for (const PieceView& piece : pieces) {
      if (absl::Status s = Take(piece); !s.ok()) return s;
    }
    return absl::OkStatus();
  }
  v1::VoxelizeResponse message;
  if (!grpc::SerializationTraits<v1::VoxelizeResponse>::Deserialize(&buffer, &message).ok()) {
    return absl::DataLossError("the server's message cannot be read");
  }
  return Take(message);
}

absl::Status Answer::Take(v1::VoxelizeResponse& message) {
  for (const v1::ResultPiece& piece : message.pieces()) {
    if (absl::Status s = Take(PieceView(piece)); !s.ok()) return s;
  }
  if (message.has_summary()) {
    summary_.Swap(message.mutable_summary());
    complete_ = true;
  }
  return absl::OkStatus();
}

absl::Status Answer::Take(const PieceView& piece) {
  if (piece.DataCrc32c() != piece.crc32c) return absl::DataLossError("a piece does not match its CRC-32C");
  bytes_ += piece.uncompressed_bytes ? CountOf(*piece.uncompressed_bytes) : piece.data_bytes();
  return absl::OkStatus();
}

void Answer::Fill(const std::string& expected_hash, Outcome& outcome) const {
  const bool lost = !complete_ || CountOf(summary_.result_bytes()) != bytes_ ||
                    (!expected_hash.empty() && summary_.content_sha256() != expected_hash);
  if (lost) {
    outcome.code = absl::StatusCode::kDataLoss;
    return;
  }
  const v1::VoxelizeStats& stats = summary_.stats();
  outcome.result_bytes = bytes_;
  outcome.received_bytes = received_bytes_;
  outcome.queue_ns = Nanoseconds(MsOf(stats.queue_time()));
  for (const v1::StageTime& stage : stats.stages()) {
    if (stage.stage() == "load" || stage.stage() == "flatten") outcome.mesh_ns += Nanoseconds(MsOf(stage.time()));
  }
  outcome.voxelize_ns = Nanoseconds(MsOf(stats.voxelize_time()));
  outcome.worker = stats.worker();
  outcome.batch_jobs = uint32_t(CountOf(stats.batch_jobs()));
  if (stats.has_batch_launches()) outcome.batch_launches = CountOf(stats.batch_launches());
  outcome.attempts = uint32_t(CountOf(stats.attempts()));
  outcome.cached = summary_.cached();
}

}  // namespace voxelpipe::cli
