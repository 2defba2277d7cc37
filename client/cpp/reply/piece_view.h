// The pieces of a result, read in place from the gRPC buffer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <google/protobuf/io/zero_copy_stream.h>
#include <grpcpp/support/byte_buffer.h>

#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// A ResultPiece that refers to bytes in another buffer.
struct PieceView {
  int32_t array = 0;
  uint32_t crc32c = 0;
  int64_t offset = 0;
  std::optional<int64_t> uncompressed_bytes;   // present: the data is a zstd frame of so many bytes
  std::vector<std::span<const uint8_t>> data;  // parts of it, in order

  PieceView() = default;
  // `piece` must outlive the view.
  explicit PieceView(const v1::ResultPiece& piece);

  uint64_t data_bytes() const;
  // CRC-32C of `data`.
  uint32_t DataCrc32c() const;
};

// Parses messages that contain pieces alone. Reuses its memory.
class PieceViewer {
 public:
  // In: a VoxelizeResponse. Out: its pieces, in order; none if it contains something else or cannot be parsed. The
  // views are valid until the next call or until the message is freed.
  std::span<const PieceView> View(grpc::ByteBuffer& message);

 private:
  bool Read(google::protobuf::io::ZeroCopyInputStream& stream);
  PieceView& Next();

  std::vector<PieceView> views_;  // those of the message first, then unused ones
  size_t count_ = 0;              // those of the message
};

}  // namespace voxelpipe
