#include "reply/raw_message.h"

#include <string>
#include <vector>

#include <grpcpp/support/slice.h>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;

// In slices of `slice_bytes`, as a message comes from the network.
grpc::ByteBuffer InSlices(const std::string& bytes, size_t slice_bytes) {
  std::vector<grpc::Slice> slices;
  for (size_t at = 0; at < bytes.size(); at += slice_bytes) slices.emplace_back(bytes.substr(at, slice_bytes));
  return grpc::ByteBuffer(slices.data(), slices.size());
}

template <typename Message>
absl::Status Read(const Message& sent, Message& read, size_t slice_bytes = 16 << 10) {
  grpc::ByteBuffer bytes = InSlices(sent.SerializeAsString(), slice_bytes);
  return ReadMessage(bytes, read);
}

std::string Settings(size_t bytes) {
  return std::string(bytes, 'n');
}

constexpr size_t kLargeMesh = 3 << 20;

TEST(RawMessageTest, MeshBytesDoNotCountWhereverSlicesEnd) {
  for (const size_t slice_bytes : {size_t{4097}, size_t{1} << 20, size_t{1} << 30}) {
    v1::VoxelizeRequest piece, read;
    piece.set_mesh_piece(std::string(kLargeMesh, '\x0a'));
    piece.set_crc32c(7);
    ASSERT_TRUE(Read(piece, read, slice_bytes).ok());
    EXPECT_EQ(read.SerializeAsString(), piece.SerializeAsString());
    v1::VoxelizeMeshRequest one, one_read;
    one.mutable_config()->set_mesh_id("x");
    one.set_mesh(std::string(kLargeMesh, '\x0a'));
    ASSERT_TRUE(Read(one, one_read, slice_bytes).ok());
    EXPECT_EQ(one_read.SerializeAsString(), one.SerializeAsString());
    v1::VoxelizeManyRequest many, many_read;
    many.set_mesh(std::string(kLargeMesh, '\x0a'));
    for (uint64_t id = 1; id < 9; ++id) {
      many.add_more()->set_id(id);
      many.mutable_more()->rbegin()->set_mesh(std::string(kLargeMesh, '\x0a'));
    }
    ASSERT_TRUE(Read(many, many_read, slice_bytes).ok());
    EXPECT_EQ(many_read.SerializeAsString(), many.SerializeAsString());
  }
}

TEST(RawMessageTest, AllElseIsBounded) {
  v1::VoxelizeRequest config, read;
  config.mutable_config()->set_mesh_id(Settings(kMaxSettingsBytes / 2));
  EXPECT_TRUE(Read(config, read).ok());
  config.mutable_config()->set_mesh_id(Settings(kMaxSettingsBytes));  // and some bytes for keys and lengths
  EXPECT_THAT(std::string(Read(config, read).message()), HasSubstr("message: at most 1048576"));
  v1::VoxelizeMeshRequest one, one_read;
  one.set_mesh(std::string(kLargeMesh, 'm'));
  *one.mutable_config() = config.config();
  EXPECT_TRUE(absl::IsInvalidArgument(Read(one, one_read)));
  // Of all jobs of a message together.
  v1::VoxelizeManyRequest many, many_read;
  for (int i = 0; i < 3; ++i) many.add_more()->mutable_config()->set_mesh_id(Settings(kMaxSettingsBytes / 2));
  EXPECT_TRUE(absl::IsInvalidArgument(Read(many, many_read)));
  v1::GetMeshRequest get, get_read;
  get.set_mesh_id(Settings(kMaxSettingsBytes));
  EXPECT_TRUE(absl::IsInvalidArgument(Read(get, get_read)));
}

// Else the fields behind are looked at for nothing.
TEST(RawMessageTest, CountingStopsWhereTooMuchHasCome) {
  const std::string settings(2 * kMaxSettingsBytes, '\x08');  // field 1 of number 8, again and again
  grpc::ByteBuffer bytes = InSlices(settings + "\x12\xff\xff\xff\x7f", 16 << 10);
  v1::VoxelizeRequest read;
  EXPECT_THAT(std::string(ReadMessage(bytes, read).message()), HasSubstr("at most 1048576"));
}

// A length that reaches beyond its message hides nothing behind it.
TEST(RawMessageTest, LengthsThatLieAreRefused) {
  const std::string settings(2 * kMaxSettingsBytes, '\0');
  for (const std::string& lie : {std::string("\x12\xff\xff\xff\x7f", 5),             // of a piece
                                 std::string("\x1a\xff\xff\xff\x7f", 5),             // of a whole request
                                 std::string("\x1a\x04\x12\xff\xff\x7f", 6),         // of a mesh in it
                                 std::string("\x12\xff\xff\xff\xff\xff\x01", 7)}) {  // beyond 32 bits
    grpc::ByteBuffer bytes = InSlices(lie + settings, 16 << 10);
    v1::VoxelizeRequest read;
    const absl::Status status = ReadMessage(bytes, read);
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr("message: its fields do not end where it ends"));
  }
}

TEST(RawMessageTest, WhatIsNoMessageIsNamed) {
  grpc::ByteBuffer bytes = InSlices("\xff\xff\xff", 16);
  v1::DeleteMeshRequest read;
  EXPECT_EQ(ReadMessage(bytes, read), absl::InvalidArgumentError("message: not a DeleteMeshRequest"));
}

}  // namespace
}  // namespace voxelpipe
