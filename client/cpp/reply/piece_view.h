// A piece of a result, read in place from the gRPC buffer.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <google/protobuf/io/zero_copy_stream.h>
#include <grpcpp/support/byte_buffer.h>

#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// A ResultPiece that refers to bytes in another buffer.
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

// Parses messages that contain only a piece; returns null for all others and for invalid bytes. Reuses its memory.
class PieceViewer {
 public:
  // In: a VoxelizeResponse. Out: its piece; null if it contains something else. The view is valid until the next call
  // or until the message is freed.
  const PieceView* View(grpc::ByteBuffer& message);

 private:
  bool Read(google::protobuf::io::ZeroCopyInputStream& stream);

  PieceView view_;
};

}  // namespace voxelpipe
