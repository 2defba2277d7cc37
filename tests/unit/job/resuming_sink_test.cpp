// The calls to the caller's sink in repeated runs.
#include "job/resuming_sink.h"

#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

class Collector final : public ResultSink {
 public:
  absl::Status Begin(const ResultHeader&) override {
    ++begins;
    return absl::OkStatus();
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    if (arrays.size() <= array) arrays.resize(array + 1);
    arrays[array].append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    ++writes;
    return absl::OkStatus();
  }

  int begins = 0, writes = 0;
  std::vector<std::string> arrays;
};

const std::vector<std::string> kArrays{"the first array", "and the second", "third"};

ResultHeader Header(int64_t size = 4) {
  ResultHeader header;
  header.grid.dims = {size, size, size};
  for (const std::string& array : kArrays) header.arrays.push_back({"target", ElementType::kU8, {array.size()}});
  return header;
}

// Hands on the first `bytes` of the arrays in pieces of this size.
void MakeUpTo(ResultSink& sink, size_t bytes, size_t piece) {
  ASSERT_TRUE(sink.Begin(Header()).ok());
  for (size_t i = 0; i < kArrays.size(); ++i) {
    const std::string& array = kArrays[i];
    for (size_t at = 0; at < array.size() && bytes > 0; at += piece) {
      const size_t n = std::min({piece, bytes, array.size() - at});
      ASSERT_TRUE(sink.Write(i, {reinterpret_cast<const uint8_t*>(array.data()) + at, n}).ok());
      bytes -= n;
    }
  }
}

TEST(ResumingSinkTest, ARunInterruptedAnywhereIsDeliveredOnceWhateverThePieces) {
  const size_t all = kArrays[0].size() + kArrays[1].size() + kArrays[2].size();
  for (size_t first = 0; first <= all; ++first) {
    for (const size_t piece : {1, 3, 100}) {
      Collector out;
      ResumingSink sink;
      sink.SetOut(out);
      MakeUpTo(sink, first, 4);
      MakeUpTo(sink, first / 2, 5);  // a second one gets less far
      MakeUpTo(sink, all, piece);
      EXPECT_EQ(out.arrays, kArrays) << first << " bytes, then pieces of " << piece;
      EXPECT_EQ(out.begins, 1);
    }
  }
}

TEST(ResumingSinkTest, OneRunPassesThroughAsItIs) {
  Collector out;
  ResumingSink sink;
  sink.SetOut(out);
  EXPECT_FALSE(sink.begun());
  MakeUpTo(sink, 1000, 100);
  EXPECT_TRUE(sink.begun());
  EXPECT_EQ(out.writes, 3);
}

TEST(ResumingSinkTest, AnotherHeaderEndsTheRun) {
  Collector out;
  ResumingSink sink;
  sink.SetOut(out);
  MakeUpTo(sink, 5, 5);
  EXPECT_EQ(sink.Begin(Header(8)).code(), absl::StatusCode::kInternal);
}

TEST(ResumingSinkTest, NothingIsKeptOnceBegun) {
  class Keeper final : public ResultSink {
   public:
    bool Keep(VoxelizeResult&&) override { return true; }
    absl::Status Begin(const ResultHeader&) override { return absl::OkStatus(); }
    absl::Status Write(size_t, std::span<const uint8_t>) override { return absl::OkStatus(); }
  };
  Keeper out;
  ResumingSink sink(out);
  EXPECT_TRUE(sink.Keep({}));
  ASSERT_TRUE(sink.Begin(Header()).ok());
  EXPECT_FALSE(sink.Keep({}));
}

}  // namespace
}  // namespace voxelpipe
