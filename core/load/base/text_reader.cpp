#include "load/base/text_reader.h"

#include <charconv>
#include <cstring>
#include <limits>

#include "absl/strings/str_cat.h"
#include "base/text.h"

namespace voxelpipe {
namespace {

constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

bool IsBlank(char c) {
  return c == ' ' || c == '\t' || c == '\v' || c == '\f';
}

bool IsBlankOrEnd(char c) {
  return IsBlank(c) || c == '\n' || c == '\r';
}

std::string_view WithoutPlus(std::string_view word) {
  if (word.size() > 1 && word[0] == '+' && word[1] != '-' && word[1] != '+') word.remove_prefix(1);
  return word;
}

size_t Find(std::string_view text, char c, size_t from) {
  if (from >= text.size()) return text.size();
  const void* const found = std::memchr(text.data() + from, c, text.size() - from);
  return found == nullptr ? text.size() : size_t(static_cast<const char*>(found) - text.data());
}

}  // namespace

TextLines::TextLines(std::string_view text) : text_(text) {
  if (text_.substr(0, kByteOrderMark.size()) == kByteOrderMark) at_ = kByteOrderMark.size();
  line_feed_ = Find(text_, '\n', at_);
}

std::optional<std::string_view> TextLines::Next() {
  if (at_ >= text_.size()) return std::nullopt;
  if (line_feed_ < at_) line_feed_ = Find(text_, '\n', at_);
  ++number_;
  const std::string_view rest = text_.substr(0, line_feed_);
  const size_t end = Find(rest, '\r', at_);
  const std::string_view line = text_.substr(at_, end - at_);
  at_ = end + 1;
  if (end < line_feed_ && at_ == line_feed_) ++at_;  // "\r\n"
  return line;
}

std::string_view Words::Next() {
  size_t begin = 0;
  while (begin < rest_.size() && IsBlank(rest_[begin])) ++begin;
  size_t end = begin;
  while (end < rest_.size() && !IsBlank(rest_[end])) ++end;
  const std::string_view word = rest_.substr(begin, end - begin);
  rest_.remove_prefix(end);
  return word;
}

std::string_view Words::Rest() const {
  std::string_view rest = rest_;
  while (!rest.empty() && IsBlank(rest.front())) rest.remove_prefix(1);
  while (!rest.empty() && IsBlank(rest.back())) rest.remove_suffix(1);
  return rest;
}

std::string_view WordStream::Next() {
  for (; at_ < text_.size() && IsBlankOrEnd(text_[at_]); ++at_) {
    const bool pair = text_[at_] == '\r' && at_ + 1 < text_.size() && text_[at_ + 1] == '\n';
    if (!IsBlank(text_[at_]) && !pair) ++line_;
  }
  const size_t begin = at_;
  while (at_ < text_.size() && !IsBlankOrEnd(text_[at_])) ++at_;
  return text_.substr(begin, at_ - begin);
}

bool ReadFloat(std::string_view word, float& value) {
  word = WithoutPlus(word);
  const char* const end = word.data() + word.size();
  const std::from_chars_result read = std::from_chars(word.data(), end, value);
  if (read.ptr != end || word.empty()) return false;
  if (read.ec == std::errc()) return true;
  if (read.ec != std::errc::result_out_of_range) return false;
  // The library does not say on which side it is out of range, but doubles have room on both.
  double wide = 0;
  if (std::from_chars(word.data(), end, wide).ec == std::errc()) {
    value = static_cast<float>(wide);
    return true;
  }
  const bool tiny = word.find("e-") != std::string_view::npos || word.find("E-") != std::string_view::npos;
  value = tiny ? 0.0f : std::numeric_limits<float>::infinity();
  return true;
}

bool ReadInteger(std::string_view word, int64_t& value) {
  word = WithoutPlus(word);
  const char* const end = word.data() + word.size();
  const std::from_chars_result read = std::from_chars(word.data(), end, value);
  return read.ec == std::errc() && read.ptr == end && !word.empty();
}

bool SameWord(std::string_view word, std::string_view lower_case) {
  if (word.size() != lower_case.size()) return false;
  for (size_t i = 0; i < word.size(); ++i) {
    const char c = word[i] >= 'A' && word[i] <= 'Z' ? char(word[i] - 'A' + 'a') : word[i];
    if (c != lower_case[i]) return false;
  }
  return true;
}

std::string Quote(std::string_view word) {
  constexpr size_t kMaxBytes = 60;
  return absl::StrCat("'", CleanText(word, kMaxBytes), "'");
}

}  // namespace voxelpipe
