// Lines, words and numbers of text formats. No locale, no copies.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace voxelpipe {

// The lines of a text, without their ends: "\n", "\r\n" or "\r". A byte order mark at the beginning is skipped.
class TextLines {
 public:
  explicit TextLines(std::string_view text);

  // The next line; empty at the end of the text.
  std::optional<std::string_view> Next();
  // That of the line that Next returned last, from 1.
  uint64_t number() const { return number_; }
  // The first byte that was not returned yet.
  size_t at() const { return at_; }

 private:
  std::string_view text_;
  size_t at_ = 0;
  size_t line_feed_ = 0;  // the first "\n" at or behind at_, searched once, so that a text without any stays linear
  uint64_t number_ = 0;
};

// The words of a line, separated by spaces and tabs.
class Words {
 public:
  explicit Words(std::string_view line) : rest_(line) {}
  // The next word; empty at the end.
  std::string_view Next();
  // What follows the words so far, without spaces around it.
  std::string_view Rest() const;

 private:
  std::string_view rest_;
};

// The next word of a text whose lines have no meaning.
class WordStream {
 public:
  // In: the text, and the number of its first line.
  WordStream(std::string_view text, uint64_t first_line) : text_(text), line_(first_line) {}
  // Empty at the end.
  std::string_view Next();
  uint64_t line() const { return line_; }  // of the word that Next returned last
  size_t left() const { return text_.size() - at_; }

 private:
  std::string_view text_;
  size_t at_ = 0;
  uint64_t line_;
};

// The word as a number, rounded once to float; false if it is none. A leading "+" is allowed. "nan" and "inf" are
// numbers, and one beyond the range of floats is infinite: callers check.
bool ReadFloat(std::string_view word, float& value);
// The same for integers; false also beyond 64 bits.
bool ReadInteger(std::string_view word, int64_t& value);

// The words are equal but for the case of ASCII letters.
bool SameWord(std::string_view word, std::string_view lower_case);

// "'word'" for messages, shortened if it is long.
std::string Quote(std::string_view word);

}  // namespace voxelpipe
