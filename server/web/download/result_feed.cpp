#include "web/download/result_feed.h"

#include <google/protobuf/arena.h>
#include <grpcpp/impl/codegen/proto_utils.h>

#include "absl/strings/str_cat.h"
#include "wire/response.h"

namespace voxelpipe {

absl::Status ResultFeed::Take(grpc::ByteBuffer& bytes) {
  v1::VoxelizeResponse message;
  if (!grpc::SerializationTraits<v1::VoxelizeResponse>::Deserialize(&bytes, &message).ok()) {
    return absl::InternalError("a message of the service cannot be read");
  }
  bytes.Clear();
  switch (message.message_case()) {
    case v1::VoxelizeResponse::kHeader: return Begin(message.header());
    case v1::VoxelizeResponse::kPiece: return Write(message.piece());
    case v1::VoxelizeResponse::kSummary: break;
    case v1::VoxelizeResponse::kWhole: {
      absl::Status s = Begin(message.whole().header());
      for (int i = 0; s.ok() && i < message.whole().pieces_size(); ++i) s = Write(message.whole().pieces(i));
      if (!s.ok()) return s;
      break;
    }
    default: return absl::OkStatus();  // the plan, progress
  }
  summary_ = message.has_whole() ? message.whole().summary() : message.summary();
  complete_ = true;
  return absl::OkStatus();
}

absl::Status ResultFeed::Begin(const v1::ResultHeader& message) {
  const absl::StatusOr<ResultHeader> header = FromMessage(message, request_);
  if (!header.ok()) return header.status();
  if (absl::Status s = may_begin_(*header); !s.ok()) return s;
  return sink_.Begin(*header);
}

absl::Status ResultFeed::Write(const v1::ResultPiece& piece) {
  return sink_.Write(piece.target(), {reinterpret_cast<const uint8_t*>(piece.data().data()), piece.data().size()});
}

absl::Status ResultFeed::Check() const {
  return complete_ ? absl::OkStatus() : absl::InternalError("the service sent no summary");
}

}  // namespace voxelpipe
