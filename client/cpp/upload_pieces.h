// The bytes of a mesh as gRPC sends them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include <google/protobuf/message_lite.h>
#include <grpcpp/support/byte_buffer.h>

namespace voxelpipe {

// Bytes of a mesh in one message.
inline constexpr size_t kUploadPieceBytes = size_t{1} << 20;

// A message of another kind.
grpc::ByteBuffer Serialized(const google::protobuf::MessageLite& message);

// Makes messages of a piece of the mesh and its CRC-32C. The bytes are copied once, since gRPC may hold what it sends
// beyond the end of a call that breaks off, into memory that is used again when it was sent. Not thread-safe; may go
// before its messages.
class UploadPieces {
 public:
  // The numbers of the two fields in the message.
  UploadPieces(int piece_field, int crc32c_field);

  // `bytes`: at most kUploadPieceBytes.
  grpc::ByteBuffer Make(std::span<const uint8_t> bytes);

 private:
  class Blocks;

  const int piece_field_, crc32c_field_;
  const std::shared_ptr<Blocks> blocks_;
};

}  // namespace voxelpipe
