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
  v1::ResultPiece& piece = *message.mutable_piece();
  piece.set_target(3);
  piece.set_offset(uint64_t{5} << 33);
  piece.set_raw_bytes(777);
  for (size_t i = 0; i < bytes; ++i) piece.mutable_data()->push_back(char(i * 7));
  piece.set_crc32c(Crc32c({reinterpret_cast<const uint8_t*>(piece.data().data()), bytes}));
  return message;
}

void ExpectEqual(const PieceView& view, const v1::ResultPiece& piece) {
  EXPECT_EQ(view.target, piece.target());
  EXPECT_EQ(view.offset, piece.offset());
  EXPECT_EQ(view.crc32c, piece.crc32c());
  EXPECT_EQ(view.raw_bytes, piece.raw_bytes());
  EXPECT_EQ(view.data_bytes(), piece.data().size());
  EXPECT_EQ(Joined(view), piece.data());
}

TEST(PieceViewTest, ReadsEveryFieldWhereverSlicesEnd) {
  const v1::VoxelizeResponse message = Message(1000);
  PieceViewer viewer;
  for (const size_t slice_bytes : {1, 2, 7, 33, 500, 2000}) {
    grpc::ByteBuffer buffer = Buffer(message.SerializeAsString(), slice_bytes);
    const PieceView* view = viewer.View(buffer);
    ASSERT_NE(view, nullptr) << slice_bytes;
    ExpectEqual(*view, message.piece());
    EXPECT_EQ(view->DataCrc32c(), message.piece().crc32c());
  }
}

TEST(PieceViewTest, CopiesNothing) {
  const grpc::Slice slice(Message(100'000).SerializeAsString());
  grpc::ByteBuffer buffer(&slice, 1);
  PieceViewer viewer;
  const PieceView* view = viewer.View(buffer);
  ASSERT_NE(view, nullptr);
  ASSERT_EQ(view->data.size(), 1u);
  EXPECT_GE(view->data[0].data(), slice.begin());
  EXPECT_LE(view->data[0].data() + view->data[0].size(), slice.end());
}

TEST(PieceViewTest, LeavesNothingFromMessageToMessage) {
  PieceViewer viewer;
  grpc::ByteBuffer full = Buffer(Message(10).SerializeAsString(), 100);
  ASSERT_NE(viewer.View(full), nullptr);
  v1::VoxelizeResponse message;
  message.mutable_piece();
  grpc::ByteBuffer empty = Buffer(message.SerializeAsString(), 100);
  const PieceView* view = viewer.View(empty);
  ASSERT_NE(view, nullptr);
  ExpectEqual(*view, v1::ResultPiece());
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
    EXPECT_EQ(viewer.View(buffer), nullptr) << text.size();
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
      const std::string more = Message(random() % 20).piece().SerializeAsString();
      text += more.substr(random() % (more.size() + 1));
      text[1] = char(text.size() - 2);
    }
    for (uint32_t changes = random() % 4; changes > 0; --changes) text[random() % text.size()] = char(random());
    grpc::ByteBuffer buffer = Buffer(text, 1 + random() % 40);
    const PieceView* view = viewer.View(buffer);
    if (view == nullptr) continue;
    v1::VoxelizeResponse message;
    // It takes a few that protobuf refuses: tags that are longer than need be.
    if (!message.ParseFromString(text)) continue;
    ++read;
    ASSERT_TRUE(message.has_piece()) << round;
    ExpectEqual(*view, message.piece());
    if (HasFailure()) FAIL() << round;
  }
  EXPECT_GT(read, 50'000);
}

}  // namespace
}  // namespace voxelpipe
