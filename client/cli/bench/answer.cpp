#include "bench/answer.h"

#include <grpcpp/impl/codegen/proto_utils.h>

namespace voxelpipe::cli {
namespace {

uint64_t Nanoseconds(double milliseconds) {
  return milliseconds > 0 ? uint64_t(milliseconds * 1e6) : 0;
}

}  // namespace

absl::Status Answer::Take(grpc::ByteBuffer& buffer) {
  received_bytes_ += buffer.Length();
  if (const PieceView* piece = viewer_.View(buffer)) return Take(*piece);
  v1::VoxelizeResponse message;
  if (!grpc::SerializationTraits<v1::VoxelizeResponse>::Deserialize(&buffer, &message).ok()) {
    return absl::DataLossError("the server's message cannot be read");
  }
  return Take(message);
}

absl::Status Answer::Take(v1::VoxelizeResponse& message) {
  switch (message.message_case()) {
    case v1::VoxelizeResponse::kPiece: return Take(PieceView(message.piece()));
    case v1::VoxelizeResponse::kSummary: Take(*message.mutable_summary()); break;
    case v1::VoxelizeResponse::kWhole: return Take(*message.mutable_whole());
    default: break;
  }
  return absl::OkStatus();
}

absl::Status Answer::Take(v1::WholeResult& whole) {
  for (const v1::ResultPiece& piece : whole.pieces()) {
    if (absl::Status s = Take(PieceView(piece)); !s.ok()) return s;
  }
  if (!whole.has_summary()) return absl::DataLossError("a whole result without its summary");
  Take(*whole.mutable_summary());
  return absl::OkStatus();
}

absl::Status Answer::Take(const PieceView& piece) {
  if (piece.DataCrc32c() != piece.crc32c) return absl::DataLossError("a piece does not match its CRC-32C");
  bytes_ += piece.raw_bytes != 0 ? piece.raw_bytes : piece.data_bytes();
  return absl::OkStatus();
}

void Answer::Take(v1::Summary& summary) {
  summary_.Swap(&summary);
  complete_ = true;
}

void Answer::Fill(const std::string& expected_hash, Outcome& outcome) const {
  // A server that does not report the size yet leaves 0 there.
  const bool lost = !complete_ || (summary_.result_bytes() != 0 && summary_.result_bytes() != bytes_) ||
                    (!expected_hash.empty() && summary_.content_sha256() != expected_hash);
  if (lost) {
    outcome.code = absl::StatusCode::kDataLoss;
    return;
  }
  const v1::VoxelizeStats& stats = summary_.stats();
  outcome.result_bytes = bytes_;
  outcome.received_bytes = received_bytes_;
  outcome.queue_ns = Nanoseconds(stats.queue_ms());
  for (const v1::StageTime& stage : stats.stages()) {
    if (stage.stage() == "load" || stage.stage() == "flatten") outcome.mesh_ns += Nanoseconds(stage.milliseconds());
  }
  outcome.voxelize_ns = Nanoseconds(stats.voxelize_ms());
  outcome.worker = stats.worker();
  outcome.batch_jobs = stats.batch_jobs();
  if (stats.has_batch_launches()) outcome.batch_launches = stats.batch_launches();
  outcome.attempts = stats.attempts();
  outcome.cached = summary_.cached();
}

}  // namespace voxelpipe::cli
