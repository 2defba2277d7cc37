// Serializes responses by hand, so that the bytes of a result are referenced and not copied.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/slice.h>

#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// One piece: its fields, and a view of its bytes.
struct CodedPiece {
  uint32_t array = 0, crc32c = 0;
  uint64_t offset = 0, raw_bytes = 0;  // see ResultPiece
  std::span<const uint8_t> data;
  std::shared_ptr<const void> owner;  // keeps `data` until gRPC has sent it; null: `data` is copied
};

// Messages of one Voxelize or VoxelizeMesh call, or of one job of a VoxelizeMany call.
class ResponseCoder {
 public:
  ResponseCoder() = default;
  explicit ResponseCoder(uint64_t job_id) : job_id_(job_id) {}

  // Any small message.
  grpc::ByteBuffer Message(const v1::VoxelizeResponse& response) const;
  grpc::ByteBuffer Piece(const CodedPiece& piece) const;
  // `head`: everything but the pieces.
  grpc::ByteBuffer Whole(const v1::WholeResult& head, std::span<const CodedPiece> pieces) const;

 private:
  std::optional<uint64_t> job_id_;
};

// Responses of a VoxelizeMany call, at least one, as one message: the first one with the others in `more`. Shares their
// bytes.
grpc::ByteBuffer AnswersInOne(std::span<const grpc::ByteBuffer* const> answers);

}  // namespace voxelpipe
