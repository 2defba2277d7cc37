#include "load/base/text_reader.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <limits>

#include "absl/strings/str_cat.h"
#include "base/text.h"

namespace voxelpipe {
namespace {

constexpr std::ptrdiff_t kBytesAStep = 1 << 20;  // in search of the end of a line, between two polls of the job
constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

// One comparison tells the characters of words, which are most, from blanks and the ends of lines.
constexpr auto IsBlank = [](char c) {
  return static_cast<unsigned char>(c) <= ' ' && (c == ' ' || c == '\t' || c == '\v' || c == '\f');
};

bool IsBlankOrEnd(char c) {
  return static_cast<unsigned char>(c) <= ' ' && (IsBlank(c) || c == '\n' || c == '\r');
}

std::string_view WithoutPlus(std::string_view word) {
  if (word.size() > 1 && word[0] == '+' && word[1] != '-' && word[1] != '+') word.remove_prefix(1);
  return word;
}

// The library's answer for a word; `is_number`: false if the word as a whole is none.
template <typename Real>
std::errc Parse(std::string_view word, Real& value, bool& is_number) {
  if (word.size() > kMaxNumberBytes) return std::errc::invalid_argument;  // which would take its time
  word = WithoutPlus(word);
  const char* const end = word.data() + word.size();
  const std::from_chars_result read = std::from_chars(word.data(), end, value);
  is_number = read.ptr == end && read.ec != std::errc::invalid_argument;
  return read.ec;
}

}  // namespace

bool TextPlace::GoOn() {
  if (at_ < end_ && !job_->Check().ok()) at_ = end_;
  look_ = Ahead();
  return at_ < end_;
}

const char* TextLines::Find(const char* from, const char* end, char c) const {
  while (from != end) {
    const char* const stop = end - from < kBytesAStep ? end : from + kBytesAStep;
    const void* const found = std::memchr(from, c, size_t(stop - from));
    if (found != nullptr) return static_cast<const char*>(found);
    from = stop;
    if (from != end && !job_->Check().ok()) break;
  }
  return end;
}

TextLines::TextLines(std::string_view text, const JobContext& job)
    : begin_(text.data()), job_(&job), place_(text, &job) {
  if (text.substr(0, kByteOrderMark.size()) == kByteOrderMark) place_.Skip(kByteOrderMark.size());
  line_feed_ = Find(place_.at(), begin_ + text.size(), '\n');
}

std::optional<std::string_view> TextLines::Next() {
  const std::string_view rest = place_.rest();
  if (rest.empty()) return std::nullopt;
  const char *const at = rest.data(), *const text_end = at + rest.size();
  if (line_feed_ < at) {
    const void* const near = std::memchr(at, '\n', size_t(std::min(text_end - at, kBytesAStep)));
    line_feed_ = near != nullptr ? static_cast<const char*>(near) : Find(at, text_end, '\n');
  }
  ++number_;
  const bool is_short = line_feed_ - at < kBytesAStep;  // as almost all are
  const void* const found = is_short ? std::memchr(at, '\r', size_t(line_feed_ - at)) : nullptr;
  const char* const end = !is_short          ? Find(at, line_feed_, '\r')
                          : found == nullptr ? line_feed_
                                             : static_cast<const char*>(found);
  const bool pair = end < line_feed_ && end + 1 == line_feed_ && line_feed_ < text_end;  // "\r\n"
  const size_t line_end = end == text_end ? 0 : pair ? 2 : 1;
  place_.Skip(size_t(end - at) + line_end);
  if (end - at >= kBytesAStep && !job_->Check().ok()) return std::nullopt;  // its end may not have been found
  return std::string_view(at, size_t(end - at));
}

std::string_view Words::Next() {
  place_.SkipWhile(IsBlank);
  const char* const begin = place_.at();
  place_.SkipWhile([](char c) { return !IsBlank(c); });
  return {begin, size_t(place_.at() - begin)};
}

std::string_view Words::Rest() const {
  TextPlace place = place_;
  place.SkipWhile(IsBlank);
  place.TrimWhile(IsBlank);
  return place.rest();
}

std::string_view WordStream::Next() {
  char before = 0;
  place_.SkipWhile([&](char c) {
    if (!IsBlankOrEnd(c)) return false;
    if (c == '\r' || (c == '\n' && before != '\r')) ++line_;
    before = c;
    return true;
  });
  const char* const begin = place_.at();
  place_.SkipWhile([](char c) { return !IsBlankOrEnd(c); });
  return {begin, size_t(place_.at() - begin)};
}

bool Contains(std::string_view text, std::string_view part, const JobContext& job) {
  constexpr size_t kStep = 1 << 20;  // characters between two polls
  for (size_t at = 0; at + part.size() <= text.size() && job.Check().ok(); at += kStep) {
    const std::string_view step = text.substr(at, kStep + part.size() - 1);
    // std's searches byte by byte.
    if (memmem(step.data(), step.size(), part.data(), part.size()) != nullptr) return true;
  }
  return false;
}

bool ReadReal(std::string_view word, float& value) {
  bool is_number = false;
  if (Parse(word, value, is_number) == std::errc() || !is_number) return is_number;
  // The library does not say on which side it is out of range, but doubles have room on both.
  double wide = 0;
  ReadReal(word, wide);
  value = static_cast<float>(wide);
  return true;
}

bool ReadReal(std::string_view word, double& value) {
  bool is_number = false;
  if (Parse(word, value, is_number) == std::errc() || !is_number) return is_number;
  const bool tiny = word.find("e-") != std::string_view::npos || word.find("E-") != std::string_view::npos;
  value = tiny ? 0.0 : std::numeric_limits<double>::infinity();
  return true;
}

bool ReadInteger(std::string_view word, int64_t& value) {
  if (word.size() > kMaxNumberBytes) return false;
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
