#include "web/http/request_body.h"

#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

using Took = RequestBody::Took;
constexpr std::chrono::hours kNever{1};

std::string Joined(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  EXPECT_TRUE(buffer.Dump(&slices).ok());
  std::string text;
  for (const grpc::Slice& slice : slices) text.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
  return text;
}

// Bytes that differ from their neighbours.
std::string Pattern(size_t bytes) {
  std::string text;
  for (size_t i = 0; i < bytes; ++i) text += char(i * 7 + i / 251);
  return text;
}

TEST(RequestBodyTest, AnyPiecesGiveTheSameMessage) {
  const std::string text = Pattern(20'000);
  for (const size_t piece : {1, 3, 5, 4096, 4097, 20'000}) {
    ByteBudget budget(1 << 20);
    RequestBody body(kFrameHeadBytes, 1 << 20, budget, kNever);
    for (size_t at = 0; at < text.size(); at += piece) ASSERT_EQ(body.Append(text.substr(at, piece)), Took::kGood);
    EXPECT_TRUE(body.status().ok());
    EXPECT_EQ(body.head(), text.substr(0, 5));
    EXPECT_EQ(body.bytes(), text.size());
    EXPECT_LE(budget.used(), 2 * text.size() + 4096) << "memory in proportion to what came";
    EXPECT_EQ(Joined(body.Take()), text.substr(5)) << piece;
    EXPECT_EQ(budget.used(), 0u) << "whoever parses it charges for it";
  }
}

TEST(RequestBodyTest, EmptyAndTruncated) {
  ByteBudget budget(1 << 20);
  RequestBody body(kFrameHeadBytes, 100, budget, kNever);
  EXPECT_EQ(body.Append("abc"), Took::kGood);
  EXPECT_EQ(body.head(), "abc");
  EXPECT_EQ(body.Take().Length(), 0u);
}

TEST(RequestBodyTest, TooLargeIsRefusedAndForgotten) {
  ByteBudget budget(1 << 20);
  RequestBody body(0, 10'000, budget, kNever);
  EXPECT_EQ(body.Append(Pattern(10'000)), Took::kGood);
  EXPECT_TRUE(body.status().ok()) << "exactly the limit";
  EXPECT_EQ(body.Append("x"), Took::kGood) << "the rest is read, so that the client gets its answer";
  EXPECT_EQ(body.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_FALSE(RetryDelay(body.status()));
  EXPECT_EQ(budget.used(), 0u);
  EXPECT_EQ(body.Append(Pattern(9'999)), Took::kGood);
  EXPECT_EQ(body.Append("x"), Took::kEndless);
}

TEST(RequestBodyTest, WaitsForOthersWhereTheBudgetIsUsedUp) {
  ByteBudget budget(16 << 10);
  ASSERT_TRUE(budget.TryTake(10 << 10));
  RequestBody body(0, 1 << 20, budget, kNever);
  EXPECT_EQ(body.Append(Pattern(20'000)), Took::kGood);
  EXPECT_EQ(body.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_TRUE(RetryDelay(body.status()));
  EXPECT_EQ(budget.used(), uint64_t{10 << 10});
  budget.Give(10 << 10);
}

TEST(RequestBodyTest, ATrickleIsIdle) {
  ByteBudget budget(1 << 20);
  RequestBody body(0, 1 << 20, budget, std::chrono::milliseconds(0));
  EXPECT_EQ(body.Append(Pattern(64 << 10)), Took::kGood) << "64 KiB begin a new period";
  RequestBody slow(0, 1 << 20, budget, std::chrono::milliseconds(-1));
  EXPECT_EQ(slow.Append("x"), Took::kIdle);
}

}  // namespace
}  // namespace voxelpipe
