#include "base/text.h"

#include <cstdio>
#include <memory>

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

// C1 steers terminals as C0 does, and the others reorder what is around them.
TEST(CleanTextTest, ReplacesControlCharactersBeyondAscii) {
  EXPECT_EQ(CleanText("a\u0080\u009b31m\u009f\u00a0z"), "a??31m?\u00a0z");
  EXPECT_EQ(CleanText("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069\u200e\u200f\u061c"), "????????????");
  EXPECT_EQ(CleanText("one\u2028two\u2029three"), "one?two?three");
  const std::string letters = "\u0627\u05d0\u200d\u2026\u202f\u2065\u206a\U0001F600";
  EXPECT_EQ(CleanText(letters), letters);
}

TEST(EscapeControlsTest, JsonKeepsItsValueAndItsLines) {
  EXPECT_EQ(EscapeControls("{\n \"\u00e9\": \"a\x7f\u0085\u202e\\u001b\"\n}"),
            "{\n \"\u00e9\": \"a\\u007f\\u0085\\u202e\\u001b\"\n}");
}

TEST(WriteLineTest, WhateverTheTextHoldsItIsOneLineWithoutControls) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::tmpfile(), std::fclose);
  ASSERT_NE(file, nullptr);
  EXPECT_TRUE(WriteLine(file.get(), "a\x1b]0;b\x07\nc\td\u009be\u202ef\u00e9\xff"));
  std::rewind(file.get());
  char text[100] = {};
  std::fread(text, 1, sizeof text - 1, file.get());
  EXPECT_STREQ(text, "a?]0;b??c?d?e?f\u00e9?\n");
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> full(std::fopen("/dev/full", "w"), std::fclose);
  ASSERT_NE(full, nullptr);
  EXPECT_FALSE(WriteLine(full.get(), "x"));
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
