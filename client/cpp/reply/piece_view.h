// A piece of a result, read where gRPC left it.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <google/protobuf/io/zero_copy_stream.h>
#include <grpcpp/support/byte_buffer.h>

#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// A ResultPiece whose bytes lie elsewhere.
struct PieceView {
  uint32_t target = 0, crc32c = 0;
  uint64_t offset = 0, raw_bytes = 0;
  std::vector<std::span<const uint8_t>> data;  // parts of it, in order

  PieceView() = default;
  // `piece` must outlive the view.
  explicit PieceView(const v1::ResultPiece& piece);

  uint64_t data_bytes() const;
  // CRC-32C of `data`.
  uint32_t DataCrc32c() const;
};

// Reads messages that are nothing but a piece; of all others, and of what is no message at all, it only says so. Keeps
// its memory from message to message.
class PieceViewer {
 public:
  // In: a VoxelizeResponse. Out: its piece; null where it holds something else. The view is good until the next call or
  // until the message's bytes go, whichever comes first.
  const PieceView* View(grpc::ByteBuffer& message);

 private:
  bool Read(google::protobuf::io::ZeroCopyInputStream& stream);

  PieceView view_;
};

}  // namespace voxelpipe
