// Lines, words and numbers of text formats. No locale, no copies. A text may be long and say little, so that reading it
// polls the job.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/job_context.h"

namespace voxelpipe {

// A place in a text that moves on to its end, and polls a job now and then. Once the job is over the place is the end
// of the text, so that a reader ends soon; what it says of the text is wrong then, and its caller polls the job.
class TextPlace {
 public:
  // `job` may be null: never polled; otherwise it must outlive this.
  TextPlace(std::string_view text, const JobContext* job)
      : at_(text.data()), end_(text.data() + text.size()), look_(job == nullptr ? end_ : Ahead()), job_(job) {}

  const char* at() const { return at_; }
  std::string_view rest() const { return {at_, size_t(end_ - at_)}; }

  // Moves on while `test` is true of the character here.
  template <typename Test>
  void SkipWhile(Test test) {
    do {
      const char* at = at_;  // a local variable, which stays in a register
      const char* const look = look_;
      while (at != look && test(*at)) ++at;
      at_ = at;
    } while (at_ == look_ && look_ != end_ && GoOn());
  }
  // Takes the end of the text back while `test` is true of the last character.
  template <typename Test>
  void TrimWhile(Test test) {
    const char* look = end_;
    for (; end_ != at_ && test(end_[-1]); --end_) {
      if (look - end_ < kStep) continue;
      look = end_;
      if (job_ == nullptr || job_->Check().ok()) continue;
      at_ = end_;
      break;
    }
    look_ = std::min(look_, end_);
  }
  // Moves on by so many characters.
  void Skip(size_t bytes) {
    at_ += bytes;
    while (at_ >= look_ && GoOn()) {}
  }

 private:
  static constexpr std::ptrdiff_t kStep = 64 << 10;  // characters between two polls

  const char* Ahead() const { return end_ - at_ < kStep ? end_ : at_ + kStep; }
  // Polls the job; false at the end of the text.
  bool GoOn();

  const char *at_, *end_;
  const char* look_;  // where the job is polled next, at most the end
  const JobContext* job_;
};

// The lines of a text, without their ends: "\n", "\r\n" or "\r". A byte order mark at the beginning is skipped.
class TextLines {
 public:
  // `job` must outlive this. It is polled; the text ends early once it is over.
  TextLines(std::string_view text, const JobContext& job);

  // The next line; empty at the end of the text.
  std::optional<std::string_view> Next();
  // That of the line that Next returned last, from 1.
  uint64_t number() const { return number_; }
  // The first byte that was not returned yet.
  size_t at() const { return size_t(place_.at() - begin_); }

 private:
  // The first such character, or the end. In steps: a line may be as long as the text.
  const char* Find(const char* from, const char* end, char c) const;

  const char* begin_;
  const JobContext* job_;
  TextPlace place_;
  const char* line_feed_;  // the first "\n" at or behind the place, searched once, so that a text without stays linear
  uint64_t number_ = 0;
};

// The words of a line, separated by spaces and tabs.
class Words {
 public:
  // `job`: as that of TextPlace. A line of an untrusted file may be as long as the file.
  explicit Words(std::string_view line, const JobContext* job = nullptr) : place_(line, job) {}
  // The next word; empty at the end.
  std::string_view Next();
  // What follows the words so far, without spaces around it.
  std::string_view Rest() const;

 private:
  TextPlace place_;
};

// The next word of a text whose lines have no meaning.
class WordStream {
 public:
  // In: the text, and the number of its first line. `job`: as that of TextPlace.
  WordStream(std::string_view text, uint64_t first_line, const JobContext* job = nullptr)
      : place_(text, job), line_(first_line) {}
  // Empty at the end.
  std::string_view Next();
  uint64_t line() const { return line_; }  // of the word that Next returned last
  size_t left() const { return place_.rest().size(); }

 private:
  TextPlace place_;
  uint64_t line_;
};

// True if the text has the part; the job is polled. False once the job is over.
bool Contains(std::string_view text, std::string_view part, const JobContext& job);

// The word as a number, rounded once; false if it is none, or longer than kMaxNumberBytes. A leading "+" is allowed.
// "nan" and "inf" are numbers, and one beyond the range of the type is infinite: callers check.
inline constexpr size_t kMaxNumberBytes = 4096;
bool ReadReal(std::string_view word, float& value);
bool ReadReal(std::string_view word, double& value);
// The same for integers; false also beyond 64 bits.
bool ReadInteger(std::string_view word, int64_t& value);

// The words are equal but for the case of ASCII letters.
bool SameWord(std::string_view word, std::string_view lower_case);

// "'word'" for messages, shortened if it is long.
std::string Quote(std::string_view word);

}  // namespace voxelpipe
