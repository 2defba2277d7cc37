// Messages with the bytes of a mesh, for gRPC.
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

// Makes messages with a piece of the mesh and its CRC-32C. Copies the bytes once, into memory that is reused after
// sending, because gRPC may hold them beyond the end of an aborted call. Not thread-safe; messages may outlive it.
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
