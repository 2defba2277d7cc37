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
  uint64_t offset = 0;
  std::optional<uint64_t> uncompressed_bytes;  // see ResultPiece
  std::span<const uint8_t> data;
  std::shared_ptr<const void> owner;  // keeps `data` until gRPC has sent it; null: `data` is copied
};

// The messages of a call with one result, or of one job of a VoxelizeBatch call.
class ResponseCoder {
 public:
  ResponseCoder() = default;
  explicit ResponseCoder(uint64_t job_id) : job_id_(job_id) {}

  // Any small message.
  grpc::ByteBuffer Message(const v1::VoxelizeResponse& response) const;
  grpc::ByteBuffer Piece(const CodedPiece& piece) const;
  // `head`: everything but the pieces.
  grpc::ByteBuffer Whole(const v1::VoxelizeResponse& head, std::span<const CodedPiece> pieces) const;

 private:
  // Begins a message: what is around a response of so many bytes.
  std::string Envelope(uint64_t response_bytes) const;

  std::optional<uint64_t> job_id_;
};

// Messages of a VoxelizeBatch call, at least one, as one message with the replies of all. Shares their bytes.
grpc::ByteBuffer RepliesInOne(std::span<const grpc::ByteBuffer* const> messages);

}  // namespace voxelpipe
