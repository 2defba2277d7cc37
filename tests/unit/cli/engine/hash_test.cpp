#include "engine/hash.h"

#include <gtest/gtest.h>

namespace voxelpipe::cli {
namespace {

std::span<const uint8_t> Bytes(const std::string& text) {
  return {reinterpret_cast<const uint8_t*>(text.data()), text.size()};
}

std::string HashOf(const std::vector<std::string>& pieces, ResultSink* next = nullptr) {
  HashingSink sink(next);
  EXPECT_TRUE(sink.Begin({}).ok());
  size_t bytes = 0;
  for (size_t i = 0; i < pieces.size(); ++i) {
    EXPECT_TRUE(sink.Write(i, Bytes(pieces[i])).ok());
    bytes += pieces[i].size();
  }
  EXPECT_EQ(sink.bytes(), bytes);
  return sink.Digest();
}

TEST(HashingSink, IsTheSha256OfAllPiecesInOrder) {
  EXPECT_EQ(HashOf({}), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  // FIPS 180-2, appendix B.1.
  EXPECT_EQ(HashOf({"abc"}), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(HashOf({"a", "bc"}), HashOf({"abc"}));
}

TEST(HashingSink, HandsOnAndReturnsWhatTheNextOneSays) {
  struct Full final : ResultSink {
    absl::Status Begin(const ResultHeader&) override { return absl::OkStatus(); }
    absl::Status Write(size_t, std::span<const uint8_t>) override { return absl::DataLossError("full"); }
  } full;
  HashingSink sink(&full);
  EXPECT_TRUE(sink.Begin({}).ok());
  EXPECT_EQ(sink.Write(0, Bytes("a")), absl::DataLossError("full"));
}

}  // namespace
}  // namespace voxelpipe::cli
