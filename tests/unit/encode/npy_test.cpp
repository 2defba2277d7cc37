#include "encode/npy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace voxelpipe {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(NpyHeader, IsVersion1AlignedAndEndsInANewline) {
  const std::string header = NpyHeader("|u1", {2, 3, 5});
  EXPECT_EQ(header.substr(0, 8), std::string("\x93NUMPY\x01\x00", 8));
  EXPECT_EQ(header.size() % 64, 0u);
  EXPECT_EQ(size_t(uint8_t(header[8])) + 256 * size_t(uint8_t(header[9])), header.size() - 10);
  EXPECT_EQ(header.back(), '\n');
  EXPECT_THAT(header, HasSubstr("{'descr': '|u1', 'fortran_order': False, 'shape': (2, 3, 5), }"));
}

TEST(NpyHeader, WritesATupleOfOneWithItsComma) {
  EXPECT_THAT(NpyHeader("<f4", {7}), HasSubstr("'shape': (7,), }"));
}

TEST(NpyHeader, TurnsToVersion2PastSixteenBitsOfLength) {
  const std::string header = NpyHeader("<f4", std::vector<uint64_t>(30000, 1));
  EXPECT_EQ(header.substr(0, 8), std::string("\x93NUMPY\x02\x00", 8));
  EXPECT_EQ(header.size() % 64, 0u);
  size_t length = 0;
  for (int byte = 3; byte >= 0; --byte) length = 256 * length + uint8_t(header[8 + size_t(byte)]);
  EXPECT_EQ(length, header.size() - 12);
  EXPECT_GT(length, 65535u);
}

TEST(NpyHeader, KeepsAlignmentForEveryLength) {
  for (size_t axes = 1; axes < 200; ++axes) {
    const std::string header = NpyHeader("<f4", std::vector<uint64_t>(axes, 9));
    ASSERT_EQ(header.size() % 64, 0u) << axes;
    ASSERT_EQ(header.back(), '\n') << axes;
  }
}

TEST(NpyElements, TurnBitsIntoBytesWhereverPiecesAreCut) {
  std::vector<uint8_t> bits(1 << 17), written;
  for (size_t i = 0; i < bits.size(); ++i) bits[i] = uint8_t(i * 37);
  const uint64_t count = bits.size() * 8 - 3;
  NpyElements elements(ElementType::kBit, count);
  const auto put = [&](std::span<const uint8_t> piece) {
    written.insert(written.end(), piece.begin(), piece.end());
    return absl::OkStatus();
  };
  const std::span<const uint8_t> all(bits);
  ASSERT_TRUE(elements.Write(all.first(1), put).ok());
  ASSERT_TRUE(elements.Write(all.subspan(1, 70000), put).ok());
  ASSERT_TRUE(elements.Write(all.subspan(70001), put).ok());
  ASSERT_EQ(written.size(), count);
  for (size_t n = 0; n < written.size(); ++n) ASSERT_EQ(written[n], bits[n / 8] >> (n % 8) & 1) << n;
}

}  // namespace
}  // namespace voxelpipe
