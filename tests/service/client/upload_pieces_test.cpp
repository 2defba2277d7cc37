// Messages of an upload, made by hand.
#include "upload_pieces.h"

#include <optional>
#include <set>
#include <string>
#include <vector>

#include <grpcpp/impl/codegen/proto_utils.h>

#include "base/checksum/crc32c.h"
#include "gtest/gtest.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {
namespace {

std::vector<uint8_t> Bytes(size_t count, uint8_t seed) {
  std::vector<uint8_t> bytes(count);
  for (size_t i = 0; i < count; ++i) bytes[i] = uint8_t(i * 31 + seed);
  return bytes;
}

v1::VoxelizeUploadRequest Received(grpc::ByteBuffer buffer) {
  v1::VoxelizeUploadRequest message;
  EXPECT_TRUE(grpc::SerializationTraits<v1::VoxelizeUploadRequest>::Deserialize(&buffer, &message).ok());
  return message;
}

UploadPieces OfVoxelize() {
  return {v1::VoxelizeUploadRequest::kPieceFieldNumber, v1::VoxelizeUploadRequest::kCrc32CFieldNumber};
}

// The block of memory that the bytes of a message lie in.
const uint8_t* BlockOf(const grpc::ByteBuffer& message) {
  std::vector<grpc::Slice> slices;
  EXPECT_TRUE(message.Dump(&slices).ok());
  return slices.back().begin();
}

TEST(UploadPiecesTest, CarryTheBytesAndTheirChecksum) {
  UploadPieces pieces = OfVoxelize();
  for (const size_t count : {size_t{1}, size_t{127}, size_t{128}, size_t{100'000}, kUploadPieceBytes}) {
    const std::vector<uint8_t> bytes = Bytes(count, 5);
    const v1::VoxelizeUploadRequest message = Received(pieces.Make(bytes));
    EXPECT_EQ(message.piece(), std::string(bytes.begin(), bytes.end()));
    EXPECT_TRUE(message.has_crc32c());
    EXPECT_EQ(message.crc32c(), Crc32c(bytes));
  }
}

TEST(UploadPiecesTest, MessagesThatAreNotSentYetKeepTheirBytes) {
  std::optional<UploadPieces> pieces(OfVoxelize());
  std::vector<grpc::ByteBuffer> messages;
  for (uint8_t i = 0; i < 20; ++i) messages.push_back(pieces->Make(Bytes(1000, i)));
  pieces.reset();
  for (uint8_t i = 0; i < 20; ++i) {
    const std::vector<uint8_t> bytes = Bytes(1000, i);
    EXPECT_EQ(Received(std::move(messages[i])).piece(), std::string(bytes.begin(), bytes.end()));
  }
}

TEST(UploadPiecesTest, MemoryOfSentMessagesIsUsedAgain) {
  UploadPieces pieces = OfVoxelize();
  std::set<const uint8_t*> blocks;
  for (uint8_t i = 0; i < 20; ++i) blocks.insert(BlockOf(pieces.Make(Bytes(100'000, i))));
  EXPECT_EQ(blocks.size(), 1u);
}

}  // namespace
}  // namespace voxelpipe
