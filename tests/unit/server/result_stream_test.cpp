#include "calls/result_stream.h"

#include <cstring>
#include <string>

#include "base/crc32c.h"
#include "gtest/gtest.h"
#include "service_state.h"

namespace voxelpipe {
namespace {

// A result with one target of each size, filled with bytes that differ.
JobOutcome MakeOutcome(const std::vector<uint64_t>& sizes) {
  JobOutcome outcome;
  outcome.result.specs.assign(sizes.size(), TargetSpec());
  uint32_t seed = 1;
  for (const uint64_t size : sizes) {
    HostBuffer buffer = *HostBuffer::Allocate(size);
    for (uint8_t& byte : buffer.bytes()) byte = uint8_t((seed = seed * 1664525 + 1013904223) >> 24);
    outcome.result.targets.push_back(std::move(buffer));
  }
  return outcome;
}

std::string Concatenate(const JobOutcome& outcome, size_t target) {
  const auto bytes = outcome.result.targets[target].bytes();
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

TEST(ResultStreamTest, SendsHeaderThenEveryByteInOrderThenSummary) {
  const std::vector<uint64_t> sizes = {1, kPieceBytes - 1, kPieceBytes, 2 * kPieceBytes + 1};
  JobOutcome outcome = MakeOutcome(sizes);
  std::vector<std::string> expected;
  Sha256 hash;
  for (size_t t = 0; t < sizes.size(); ++t) {
    expected.push_back(Concatenate(outcome, t));
    hash.Update(outcome.result.targets[t].bytes());
  }
  ResultStream stream(std::move(outcome));

  v1::VoxelizeResponse response;
  ASSERT_TRUE(stream.Next(response));
  ASSERT_TRUE(response.has_header());
  EXPECT_EQ(response.header().arrays_size(), int(sizes.size()));

  std::vector<std::string> received(sizes.size());
  size_t pieces = 0;
  while (stream.Next(response) && response.has_piece()) {
    const v1::ResultPiece& piece = response.piece();
    ASSERT_LT(piece.target(), sizes.size());
    std::string& target = received[piece.target()];
    EXPECT_EQ(piece.offset(), target.size());
    EXPECT_LE(piece.data().size(), kPieceBytes);
    EXPECT_EQ(piece.crc32c(), Crc32c({reinterpret_cast<const uint8_t*>(piece.data().data()), piece.data().size()}));
    target += piece.data();
    ++pieces;
  }
  EXPECT_EQ(pieces, 1u + 1 + 1 + 3);
  EXPECT_EQ(received, expected);
  EXPECT_EQ(stream.bytes_sent(), 4 * kPieceBytes + 1);
  ASSERT_TRUE(response.has_summary());
  EXPECT_EQ(response.summary().content_sha256(), hash.HexDigest());
  EXPECT_FALSE(stream.Next(response));
  EXPECT_FALSE(stream.Next(response));
}

TEST(ResultStreamTest, TheHashIsThatOfTheStandard) {
  Sha256 hash;
  const std::string text = "abc";
  hash.Update({reinterpret_cast<const uint8_t*>(text.data()), 1});
  hash.Update({reinterpret_cast<const uint8_t*>(text.data()) + 1, 2});
  EXPECT_EQ(hash.HexDigest(), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(ResultStreamTest, TheSummaryTellsWhatIsKnown) {
  JobOutcome outcome = MakeOutcome({3});
  outcome.result.stats.occupied = 17;
  outcome.result.stats.stages = {{"load", 1}, {"flatten", 2}};
  outcome.report.open_edges = 4;
  outcome.examined = true;
  outcome.peak_bytes = 99;
  outcome.warnings.assign(1000, "node '\xff' is odd");
  ResultStream stream(std::move(outcome));
  v1::VoxelizeResponse response;
  do {
    ASSERT_TRUE(stream.Next(response));
  } while (!response.has_summary());
  const v1::Summary& summary = response.summary();
  EXPECT_EQ(summary.stats().occupied(), 17u);
  ASSERT_EQ(summary.stats().stages_size(), 2);
  EXPECT_EQ(summary.stats().stages(1).stage(), "flatten");
  EXPECT_EQ(summary.mesh().open_edges(), 4u);
  EXPECT_EQ(summary.peak_bytes(), 99u);
  EXPECT_EQ(summary.mesh().warnings_size(), 32) << "a stranger's file must not make the summary large";
  EXPECT_EQ(summary.mesh().warnings(0), "node '?' is odd");
}

}  // namespace
}  // namespace voxelpipe
