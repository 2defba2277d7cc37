#include "upload_pieces.h"

#include <algorithm>
#include <mutex>
#include <utility>
#include <vector>

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>
#include <grpcpp/impl/codegen/proto_utils.h>
#include <grpcpp/support/slice.h>

#include "base/checksum/crc32c.h"

namespace voxelpipe {
namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedOutputStream;

// While one is being sent another one is made.
constexpr size_t kKeptBlocks = 4;

}  // namespace

// Memory for pieces. gRPC's threads return blocks, possibly after the last message was made.
class UploadPieces::Blocks {
 public:
  using Block = std::unique_ptr<uint8_t[]>;

  Block Take() {
    {
      const std::lock_guard lock(mutex_);
      if (!free_.empty()) {
        Block block = std::move(free_.back());
        free_.pop_back();
        return block;
      }
    }
    return Block(new uint8_t[kUploadPieceBytes]);
  }
  void Return(Block block) {
    const std::lock_guard lock(mutex_);
    if (free_.size() < kKeptBlocks) free_.push_back(std::move(block));
  }

 private:
  std::mutex mutex_;
  std::vector<Block> free_;
};

grpc::ByteBuffer Serialized(const google::protobuf::MessageLite& message) {
  grpc::ByteBuffer bytes;
  bool own_bytes = false;
  grpc::SerializationTraits<google::protobuf::MessageLite>::Serialize(message, &bytes, &own_bytes);
  return bytes;
}

UploadPieces::UploadPieces(int piece_field, int crc32c_field)
    : piece_field_(piece_field), crc32c_field_(crc32c_field), blocks_(std::make_shared<Blocks>()) {}

grpc::ByteBuffer UploadPieces::Make(std::span<const uint8_t> bytes) {
  struct InUse {
    std::shared_ptr<Blocks> blocks;
    Blocks::Block block;
  };
  auto in_use = std::make_unique<InUse>(InUse{blocks_, blocks_->Take()});
  uint8_t* const copy = in_use->block.get();
  std::copy(bytes.begin(), bytes.end(), copy);

  uint8_t head[32];
  uint8_t* end = CodedOutputStream::WriteTagToArray(
      WireFormatLite::MakeTag(crc32c_field_, WireFormatLite::WIRETYPE_FIXED32), head);
  // Of the original bytes, so that an error in the copy is found too.
  end = CodedOutputStream::WriteLittleEndian32ToArray(Crc32c(bytes), end);
  end = CodedOutputStream::WriteTagToArray(
      WireFormatLite::MakeTag(piece_field_, WireFormatLite::WIRETYPE_LENGTH_DELIMITED), end);
  end = CodedOutputStream::WriteVarint32ToArray(uint32_t(bytes.size()), end);
  const grpc::Slice slices[] = {grpc::Slice(head, size_t(end - head)),
                                grpc::Slice(
                                    copy, bytes.size(),
                                    [](void* user) {
                                      const std::unique_ptr<InUse> back(static_cast<InUse*>(user));
                                      back->blocks->Return(std::move(back->block));
                                    },
                                    in_use.release())};
  return {slices, 2};
}

}  // namespace voxelpipe
