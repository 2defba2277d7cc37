// Pieces read by hand are what protobuf reads.
#include "reply/piece_view.h"

#include <random>
#include <string>
#include <vector>

#include <grpcpp/support/slice.h>

#include "base/checksum/crc32c.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

// `text` in slices of `slice_bytes`.
grpc::ByteBuffer Buffer(const std::string& text, size_t slice_bytes) {
  std::vector<grpc::Slice> slices;
  for (size_t at = 0; at < text.size(); at += slice_bytes) slices.emplace_back(text.substr(at, slice_bytes));
  return {slices.data(), slices.size()};
}

std::string Joined(const PieceView& view) {
  std::string text;
  for (const std::span<const uint8_t> part : view.data)
    text.append(reinterpret_cast<const char*>(part.data()), part.size());
  return text;
}

v1::VoxelizeResponse Message(size_t bytes) {
  v1::VoxelizeResponse message;
  v1::ResultPiece& piece = *message.add_pieces();
  piece.set_array(3);
  piece.set_offset(int64_t{5} << 33);
  piece.set_uncompressed_bytes(777);
  for (size_t i = 0; i < bytes; ++i) piece.mutable_data()->push_back(char(i * 7));
  piece.set_crc32c(Crc32c({reinterpret_cast<const uint8_t*>(piece.data().data()), bytes}));
  return message;
}

void ExpectEqual(const PieceView& view, const v1::ResultPiece& piece) {
  EXPECT_EQ(view.array, piece.array());
  EXPECT_EQ(view.offset, piece.offset());
  EXPECT_EQ(view.crc32c, piece.crc32c());
  EXPECT_EQ(view.uncompressed_bytes.has_value(), piece.has_uncompressed_bytes());
  EXPECT_EQ(view.uncompressed_bytes.value_or(0), piece.uncompressed_bytes());
  EXPECT_EQ(view.data_bytes(), piece.data().size());
  EXPECT_EQ(Joined(view), piece.data());
}

void ExpectEqual(std::span<const PieceView> views, const v1::VoxelizeResponse& message) {
  ASSERT_EQ(views.size(), size_t(message.pieces_size()));
  for (size_t i = 0; i < views.size(); ++i) ExpectEqual(views[i], message.pieces(int(i)));
}

TEST(PieceViewTest, ReadsEveryFieldWhereverSlicesEnd) {
  const v1::VoxelizeResponse message = Message(1000);
  PieceViewer viewer;
  for (const size_t slice_bytes : {1, 2, 7, 33, 500, 2000}) {
    grpc::ByteBuffer buffer = Buffer(message.SerializeAsString(), slice_bytes);
    const std::span<const PieceView> views = viewer.View(buffer);
    ASSERT_EQ(views.size(), 1u) << slice_bytes;
    ExpectEqual(views, message);
    EXPECT_EQ(views[0].DataCrc32c(), message.pieces(0).crc32c());
  }
}

TEST(PieceViewTest, ReadsSeveralPieces) {
  v1::VoxelizeResponse message = Message(3);
  message.MergeFrom(Message(0));
  message.mutable_pieces(1)->clear_uncompressed_bytes();
  message.MergeFrom(Message(200));
  PieceViewer viewer;
  for (const size_t slice_bytes : {1, 7, 2000}) {
    grpc::ByteBuffer buffer = Buffer(message.SerializeAsString(), slice_bytes);
    ExpectEqual(viewer.View(buffer), message);
  }
}

TEST(PieceViewTest, ReadsNegativeNumbers) {
  v1::VoxelizeResponse message = Message(3);
  message.mutable_pieces(0)->set_array(-1);
  message.mutable_pieces(0)->set_offset(INT64_MIN);
  message.mutable_pieces(0)->set_uncompressed_bytes(-7);
  PieceViewer viewer;
  grpc::ByteBuffer buffer = Buffer(message.SerializeAsString(), 5);
  ExpectEqual(viewer.View(buffer), message);
}

TEST(PieceViewTest, CopiesNothing) {
  const grpc::Slice slice(Message(100'000).SerializeAsString());
  grpc::ByteBuffer buffer(&slice, 1);
  PieceViewer viewer;
  const std::span<const PieceView> views = viewer.View(buffer);
  ASSERT_EQ(views.size(), 1u);
  ASSERT_EQ(views[0].data.size(), 1u);
  EXPECT_GE(views[0].data[0].data(), slice.begin());
  EXPECT_LE(views[0].data[0].data() + views[0].data[0].size(), slice.end());
}

TEST(PieceViewTest, LeavesNothingFromMessageToMessage) {
  PieceViewer viewer;
  v1::VoxelizeResponse two = Message(10);
  two.MergeFrom(Message(20));
  grpc::ByteBuffer full = Buffer(two.SerializeAsString(), 100);
  ASSERT_EQ(viewer.View(full).size(), 2u);
  v1::VoxelizeResponse message;
  message.add_pieces();
  grpc::ByteBuffer empty = Buffer(message.SerializeAsString(), 100);
  ExpectEqual(viewer.View(empty), message);
}

TEST(PieceViewTest, OtherMessagesAreNotItsOwn) {
  PieceViewer viewer;
  v1::VoxelizeResponse header, summary;
  header.mutable_header();
  summary.mutable_summary()->set_peak_bytes(5);
  const std::string piece = Message(50).SerializeAsString();
  for (const std::string& text : {header.SerializeAsString(), summary.SerializeAsString(), std::string(),
                                  piece + summary.SerializeAsString(), header.SerializeAsString() + piece,
                                  piece.substr(0, piece.size() - 1), piece + "\xff", std::string("\xff\xff\xff", 3)}) {
    grpc::ByteBuffer buffer = Buffer(text, 16);
    EXPECT_TRUE(viewer.View(buffer).empty()) << text.size();
  }
}

// What both read they read alike: unknown fields, fields that come twice or in another order, lengths that lie.
TEST(PieceViewTest, AgreesWithProtobufOnBrokenMessages) {
  std::mt19937 random(1);
  PieceViewer viewer;
  int read = 0;
  for (int round = 0; round < 200'000; ++round) {
    std::string text = Message(random() % 20).SerializeAsString();
    if (round % 3 == 0) {  // fields of a second piece in the same one
      const std::string more = Message(random() % 20).pieces(0).SerializeAsString();
      text += more.substr(random() % (more.size() + 1));
      text[1] = char(text.size() - 2);
    }
    if (round % 5 == 0) text += Message(random() % 20).SerializeAsString();
    for (uint32_t changes = random() % 4; changes > 0; --changes) text[random() % text.size()] = char(random());
    grpc::ByteBuffer buffer = Buffer(text, 1 + random() % 40);
    const std::span<const PieceView> views = viewer.View(buffer);
    if (views.empty()) continue;
    v1::VoxelizeResponse message;
    // It takes a few that protobuf refuses: tags that are longer than need be.
    if (!message.ParseFromString(text)) continue;
    ++read;
    ExpectEqual(views, message);
    if (HasFailure()) FAIL() << round;
  }
  EXPECT_GT(read, 50'000);
}

}  // namespace
}  // namespace voxelpipe
