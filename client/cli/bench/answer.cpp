#include "bench/answer.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>
#include <grpcpp/impl/codegen/proto_utils.h>
#include <grpcpp/support/proto_buffer_reader.h>

namespace voxelpipe::cli {
namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedInputStream;

constexpr uint32_t kPieceTag =
    WireFormatLite::MakeTag(v1::VoxelizeResponse::kPieceFieldNumber, WireFormatLite::WIRETYPE_LENGTH_DELIMITED);
constexpr uint32_t kDataTag =
    WireFormatLite::MakeTag(v1::ResultPiece::kDataFieldNumber, WireFormatLite::WIRETYPE_LENGTH_DELIMITED);
constexpr uint32_t kRawBytesTag =
    WireFormatLite::MakeTag(v1::ResultPiece::kRawBytesFieldNumber, WireFormatLite::WIRETYPE_VARINT);

struct PieceSize {
  uint64_t data_bytes = 0, raw_bytes = 0;
};

// True if the message is a piece that can be read; its data is stepped over.
bool ReadPieceSize(grpc::ByteBuffer& buffer, PieceSize& size) {
  grpc::ProtoBufferReader reader(&buffer);
  CodedInputStream in(&reader);
  if (in.ReadTag() != kPieceTag) return false;
  uint32_t length = 0;
  if (!in.ReadVarint32(&length)) return false;
  const CodedInputStream::Limit limit = in.PushLimit(int(length));
  while (const uint32_t tag = in.ReadTag()) {
    if (tag == kDataTag) {
      uint32_t bytes = 0;
      if (!in.ReadVarint32(&bytes) || !in.Skip(int(bytes))) return false;
      size.data_bytes += bytes;
    } else if (tag == kRawBytesTag) {
      if (!in.ReadVarint64(&size.raw_bytes)) return false;
    } else if (!WireFormatLite::SkipField(&in, tag)) {
      return false;
    }
  }
  const bool whole = in.BytesUntilLimit() == 0;
  in.PopLimit(limit);
  return whole;
}

uint64_t Nanoseconds(double milliseconds) {
  return milliseconds > 0 ? uint64_t(milliseconds * 1e6) : 0;
}

}  // namespace

absl::Status Answer::Take(grpc::ByteBuffer& buffer) {
  received_bytes_ += buffer.Length();
  PieceSize size;
  grpc::ByteBuffer copy = buffer;  // shares the bytes; reading uses a buffer up
  if (ReadPieceSize(copy, size)) {
    bytes_ += size.raw_bytes != 0 ? size.raw_bytes : size.data_bytes;
    return absl::OkStatus();
  }
  v1::VoxelizeResponse message;
  if (!grpc::SerializationTraits<v1::VoxelizeResponse>::Deserialize(&buffer, &message).ok()) {
    return absl::DataLossError("the server's message cannot be read");
  }
  return Take(message);
}

absl::Status Answer::Take(const v1::VoxelizeResponse& message) {
  switch (message.message_case()) {
    case v1::VoxelizeResponse::kPiece: Take(message.piece()); break;
    case v1::VoxelizeResponse::kSummary: Take(message.summary()); break;
    case v1::VoxelizeResponse::kWhole: return Take(message.whole());
    default: break;
  }
  return absl::OkStatus();
}

absl::Status Answer::Take(const v1::WholeResult& whole) {
  for (const v1::ResultPiece& piece : whole.pieces()) Take(piece);
  if (!whole.has_summary()) return absl::DataLossError("a whole result without its summary");
  Take(whole.summary());
  return absl::OkStatus();
}

void Answer::Take(const v1::ResultPiece& piece) {
  bytes_ += piece.raw_bytes() != 0 ? piece.raw_bytes() : piece.data().size();
}

void Answer::Take(const v1::Summary& summary) {
  summary_ = summary;
  complete_ = true;
}

void Answer::Fill(const std::string& expected_hash, Outcome& outcome) const {
  // A server that does not tell the size yet leaves 0 there.
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
