#include "base/checksum/crc32c.h"

#include <string_view>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

uint32_t CrcOf(std::string_view text) {
  return Crc32c({reinterpret_cast<const uint8_t*>(text.data()), text.size()});
}

// The check value of the catalogue of CRCs and the vectors of RFC 3720, appendix B.4.
TEST(Crc32cTest, GivesThePublishedValues) {
  EXPECT_EQ(CrcOf(""), 0u);
  EXPECT_EQ(CrcOf("123456789"), 0xE3069283u);
  EXPECT_EQ(Crc32c(std::vector<uint8_t>(32, 0)), 0x8A9136AAu);
  EXPECT_EQ(Crc32c(std::vector<uint8_t>(32, 0xFF)), 0x62A8AB43u);
}

TEST(Crc32cTest, GoesOnFromPartToPart) {
  std::vector<uint8_t> bytes(5000);
  for (size_t i = 0; i < bytes.size(); ++i) bytes[i] = uint8_t(i * 31);
  const std::span<const uint8_t> all(bytes);
  for (const size_t cut : {0, 1, 15, 64, 1023, 4999, 5000}) {
    EXPECT_EQ(ExtendCrc32c(Crc32c(all.first(cut)), all.subspan(cut)), Crc32c(all)) << cut;
  }
}

TEST(Crc32cTest, SeesOneFlippedBit) {
  std::vector<uint8_t> bytes(1 << 16);
  for (size_t i = 0; i < bytes.size(); ++i) bytes[i] = uint8_t(i * 31);
  const uint32_t before = Crc32c(bytes);
  bytes[40000] ^= 4;
  EXPECT_NE(Crc32c(bytes), before);
}

}  // namespace
}  // namespace voxelpipe
