#include "base/text.h"

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

TEST(CleanTextTest, KeepsValidText) {
  EXPECT_EQ(CleanText("", 10), "");
  EXPECT_EQ(CleanText("plain", 5), "plain");
  EXPECT_EQ(CleanText("\u00e9\u20ac\U0001F600", 20), "\u00e9\u20ac\U0001F600");
}

TEST(CleanTextTest, ReplacesWhatIsNotUtf8) {
  EXPECT_EQ(CleanText("a\x80z", 10), "a?z");             // a continuation alone
  EXPECT_EQ(CleanText("a\xc3", 10), "a?");               // cut short
  EXPECT_EQ(CleanText("\xc0\xaf", 10), "??");            // overlong
  EXPECT_EQ(CleanText("\xe0\x80\x80", 10), "???");       // overlong
  EXPECT_EQ(CleanText("\xed\xa0\x80", 10), "???");       // surrogate
  EXPECT_EQ(CleanText("\xf4\x90\x80\x80", 10), "????");  // beyond U+10FFFF
  EXPECT_EQ(CleanText("\xf5z", 10), "?z");
}

TEST(CleanTextTest, ReplacesControlCharacters) {
  EXPECT_EQ(CleanText(std::string_view("a\n\0\x7f z", 6), 10), "a??? z");
}

TEST(CleanTextTest, CutsAtACharacter) {
  EXPECT_EQ(CleanText("abcdefgh", 6), "abc...");
  EXPECT_EQ(CleanText("ab\u20acdefg", 6), "ab...");  // the euro sign takes 3 bytes and would end at 5
  EXPECT_EQ(CleanText("abcdefgh", 8), "abcdefgh");
  EXPECT_EQ(CleanText("abcdefgh", 2), "..");
}

TEST(TextTest, BytesAreExactAndFromAMebibyteOnReadable) {
  EXPECT_EQ(BytesText(1000), "1000 bytes");
  EXPECT_EQ(BytesText((1 << 20) - 1), "1048575 bytes");
  EXPECT_EQ(BytesText(1 << 20), "1 MiB (1048576 bytes)");
  EXPECT_EQ(BytesText(5694653072), "5.3 GiB (5694653072 bytes)");
  EXPECT_EQ(BytesText(uint64_t{16} << 30), "16 GiB (17179869184 bytes)");
  EXPECT_EQ(BytesText(UINT64_MAX), "16 EiB (18446744073709551615 bytes)");
}

}  // namespace
}  // namespace voxelpipe
