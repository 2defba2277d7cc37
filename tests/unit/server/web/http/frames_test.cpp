#include "web/http/frames.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;

TEST(FramesTest, ARequestIsOneFrame) {
  EXPECT_TRUE(CheckRequestFrame(std::string_view("\0\0\0\0\0", 5), 5).ok()) << "an empty message";
  EXPECT_TRUE(CheckRequestFrame(std::string_view("\0\x01\x02\x03\x04", 5), 5 + 0x01020304).ok());
  EXPECT_EQ(CheckRequestFrame("", 0).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(CheckRequestFrame(std::string_view("\0\0\0\0", 4), 4).code(), absl::StatusCode::kInvalidArgument);
  const absl::Status cut = CheckRequestFrame(std::string_view("\0\0\0\0\x09", 5), 13);
  EXPECT_EQ(cut.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(cut.message()), HasSubstr("9 bytes, 8 follow"));
  EXPECT_EQ(CheckRequestFrame(std::string_view("\0\0\0\0\x02", 5), 13).code(), absl::StatusCode::kInvalidArgument)
      << "a second frame";
  EXPECT_EQ(CheckRequestFrame(std::string_view("\x01\0\0\0\0", 5), 5).code(), absl::StatusCode::kUnimplemented);
  EXPECT_EQ(CheckRequestFrame(std::string_view("\x80\0\0\0\0", 5), 5).code(), absl::StatusCode::kInvalidArgument);
}

TEST(FramesTest, HeadsAreBigEndian) {
  EXPECT_EQ(HeadOfMessage(0x01020304), (FrameHead{0, 1, 2, 3, 4}));
}

TEST(FramesTest, TrailersAreLinesOfTheLastFrame) {
  EXPECT_EQ(TrailerFrame(grpc::Status::OK), std::string("\x80\0\0\0\x10grpc-status: 0\r\n", 21));
  const std::string frame = TrailerFrame(
      {grpc::StatusCode::NOT_FOUND, "no \"Käse\"\r\n100%", std::string("\x01\x02\xff", 3)}, {{"a", "b\n"}});
  EXPECT_EQ(
      frame.substr(5),
      "grpc-status: 5\r\ngrpc-message: no \"K%C3%A4se\"%0D%0A100%25\r\ngrpc-status-details-bin: AQL/\r\na: b%0A\r\n");
  EXPECT_EQ(uint8_t(frame[4]), frame.size() - 5);
}

TEST(FramesTest, BinaryTrailersHaveNoPadding) {
  EXPECT_THAT(TrailerFrame({grpc::StatusCode::INTERNAL, "", "a"}), HasSubstr("details-bin: YQ\r\n"));
}

TEST(FramesTest, Timeouts) {
  using std::chrono::nanoseconds;
  EXPECT_EQ(*ParseTimeout("250m"), nanoseconds(250'000'000));
  EXPECT_EQ(*ParseTimeout("1H"), nanoseconds(3'600'000'000'000));
  EXPECT_EQ(*ParseTimeout("2M"), nanoseconds(120'000'000'000));
  EXPECT_EQ(*ParseTimeout("3S"), nanoseconds(3'000'000'000));
  EXPECT_EQ(*ParseTimeout("4u"), nanoseconds(4'000));
  EXPECT_EQ(*ParseTimeout("0n"), nanoseconds(0));
  EXPECT_GT(*ParseTimeout("99999999H"), nanoseconds(0)) << "no overflow";
  for (const char* const wrong : {"", "1", "S", "-1S", "1.5S", "123456789S", "1s", " 1S", "0x1S"}) {
    EXPECT_EQ(ParseTimeout(wrong).status().code(), absl::StatusCode::kInvalidArgument) << wrong;
  }
}

}  // namespace
}  // namespace voxelpipe
