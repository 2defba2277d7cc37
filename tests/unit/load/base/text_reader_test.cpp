// Reading text ends soon after its job, wherever the text says nothing. Counted in what is read, not in time.
#include "load/base/text_reader.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using ::testing::ElementsAre;

constexpr size_t kMaxAfterCancel = 64 << 10;  // characters between two polls

std::vector<std::string> LinesOf(std::string_view text) {
  const JobContext job;
  TextLines lines(text, job);
  std::vector<std::string> all;
  while (const std::optional<std::string_view> line = lines.Next()) all.emplace_back(*line);
  EXPECT_EQ(lines.number(), all.size());
  EXPECT_EQ(lines.at(), text.size());
  return all;
}

TEST(TextLinesTest, EndsOfLines) {
  EXPECT_THAT(LinesOf(""), ElementsAre());
  EXPECT_THAT(LinesOf("\n"), ElementsAre(""));
  EXPECT_THAT(LinesOf("a"), ElementsAre("a"));
  EXPECT_THAT(LinesOf("a\nb\r\nc\rd"), ElementsAre("a", "b", "c", "d"));
  EXPECT_THAT(LinesOf("a\r"), ElementsAre("a"));
  EXPECT_THAT(LinesOf("a\r\n"), ElementsAre("a"));
  EXPECT_THAT(LinesOf("\r\r\n\n"), ElementsAre("", "", ""));
  EXPECT_THAT(LinesOf("\xEF\xBB\xBF"
                      "a\n"),
              ElementsAre("a"));
}

TEST(TextLinesTest, LongTextsWithARunningJob) {
  std::string text;
  size_t count = 0;
  for (; text.size() < 4 * kMaxAfterCancel; ++count) text += "word " + std::string(count % 90, ' ') + "word\r\n";
  text += std::string(3 * kMaxAfterCancel, 'x');  // one word
  const JobContext job;
  EXPECT_EQ(LinesOf(text).size(), count + 1);
  size_t words = 0;
  WordStream stream(text, 1, &job);
  while (!stream.Next().empty()) ++words;
  EXPECT_EQ(words, 2 * count + 1);
  EXPECT_EQ(stream.line(), count + 1);
  Words line(text, &job);  // as if ends of lines were parts of words
  std::string_view last;
  for (std::string_view word = line.Next(); !word.empty(); word = line.Next()) last = word;
  EXPECT_EQ(last.size(), 6 + 3 * kMaxAfterCancel);
}

TEST(WordStreamTest, CountsLines) {
  WordStream words("a\r\nb\rc\n\nd", 7);
  for (const auto& [word, line] : {std::pair{"a", 7u}, {"b", 8u}, {"c", 9u}, {"d", 11u}}) {
    EXPECT_EQ(words.Next(), word);
    EXPECT_EQ(words.line(), line) << word;
  }
  EXPECT_EQ(words.Next(), "");
  EXPECT_EQ(words.left(), 0u);
}

TEST(TextPollTest, ATextEndsWithItsJob) {
  JobContext job;
  job.Cancel();
  size_t count = 0;
  for (const char* line : {"\n", "#\n", "# comment\r\n", "v\r"}) {
    std::string text;
    while (text.size() < 16 * kMaxAfterCancel) text += line;
    TextLines lines(text, job);
    for (count = 0; lines.Next();) ++count;
    EXPECT_LE(count, kMaxAfterCancel);
    EXPECT_GT(count, 1u);
    WordStream stream(text, 1, &job);
    for (count = 0; !stream.Next().empty();) ++count;
    EXPECT_LE(count, kMaxAfterCancel);
    EXPECT_EQ(stream.left(), 0u);
  }
}

TEST(TextPollTest, ALineEndsWithItsJob) {
  JobContext job;
  job.Cancel();
  std::string line;
  while (line.size() < 16 * kMaxAfterCancel) line += "endloop ";
  Words words(line, &job);
  size_t count = 0;
  while (!words.Next().empty()) ++count;
  EXPECT_LE(count, kMaxAfterCancel);
  EXPECT_TRUE(words.Rest().empty());

  const std::string blanks = std::string(16 * kMaxAfterCancel, ' ') + "behind";
  EXPECT_EQ(Words(blanks, &job).Next(), "");
  EXPECT_EQ(Words(blanks, &job).Rest(), "");
  EXPECT_EQ(Words(blanks).Rest(), "behind");
}

TEST(TextPollTest, ALineThatIsTheTextEndsWithItsJob) {
  JobContext job;
  const std::string line(4 << 20, '#');
  EXPECT_THAT(LinesOf(line + "\nb"), ElementsAre(line, "b"));
  job.Cancel();
  EXPECT_FALSE(TextLines(line, job).Next().has_value());
  EXPECT_FALSE(TextLines(line + "\nb", job).Next().has_value());
}

TEST(TextPollTest, ASearchEndsWithItsJob) {
  const std::string part = "mtllib";
  constexpr size_t kStep = 1 << 20;
  JobContext job;
  for (const size_t at : {size_t{0}, kStep - part.size(), kStep - 3, kStep, 3 * kStep - 1}) {
    std::string text(3 * kStep + part.size(), 'm');
    text.replace(at, part.size(), part);
    EXPECT_TRUE(Contains(text, part, job)) << at;
    text[at + 1] = 'x';
    EXPECT_FALSE(Contains(text, part, job)) << at;
  }
  EXPECT_FALSE(Contains("mtlli", part, job));
  job.Cancel();
  EXPECT_FALSE(Contains(std::string(kStep, ' ') + part, part, job));
}

}  // namespace
}  // namespace voxelpipe
