// What the caller's sink hears of runs that begin anew.
#include "job/resuming_sink.h"

#include <gtest/gtest.h>

#include <string>

namespace voxelpipe {
namespace {

class Text final : public ResultSink {
 public:
  absl::Status Begin(const ResultHeader&) override {
    text += "(";
    return absl::OkStatus();
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    text += std::to_string(array) + ":" + std::string(bytes.begin(), bytes.end()) + " ";
    return absl::OkStatus();
  }
  std::string text;
};

class ResumingSinkTest : public ::testing::Test {
 protected:
  void Write(size_t array, std::string_view piece) {
    const auto* const bytes = reinterpret_cast<const uint8_t*>(piece.data());
    ASSERT_TRUE(sink_.Write(array, {bytes, piece.size()}).ok());
  }
  Text to_;
  ResumingSink sink_{to_};
};

TEST_F(ResumingSinkTest, HandsOnWhatIsNewInWhateverPieces) {
  ASSERT_TRUE(sink_.Begin({}).ok());
  Write(0, "abc");
  Write(0, "de");
  sink_.Restart();
  ASSERT_TRUE(sink_.Begin({}).ok());
  Write(0, "a");
  Write(0, "bcd");
  Write(0, "efg");
  Write(1, "xy");
  sink_.Restart();
  Write(0, "abcdefgh");
  Write(1, "xyz");
  EXPECT_EQ(to_.text, "(0:abc 0:de 0:fg 1:xy 0:h 1:z ");
}

TEST_F(ResumingSinkTest, NothingIsKeptOnceBegun) {
  EXPECT_FALSE(sink_.Keep({}));  // the sink does not
  ASSERT_TRUE(sink_.Begin({}).ok());
  EXPECT_FALSE(sink_.Keep({}));
}

}  // namespace
}  // namespace voxelpipe
