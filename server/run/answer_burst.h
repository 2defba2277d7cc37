// Answers that one thread gives shortly after another.
#pragma once

#include <algorithm>
#include <chrono>
#include <functional>
#include <utility>
#include <vector>

namespace voxelpipe {

// While one lives on a thread, what sends that thread's answers may wait for those that follow, so that they leave
// together: a message costs as much as a small job. Not longer than `longest`, if jobs end that often: the time is read
// when an answer is deferred.
class AnswerBurst {
 public:
  using Clock = std::chrono::steady_clock;

  explicit AnswerBurst(Clock::duration longest) : longest_(longest), outer_(std::exchange(here_, this)) {}
  // Does what was put off.
  ~AnswerBurst() {
    here_ = outer_;
    Send();
  }
  AnswerBurst(const AnswerBurst&) = delete;
  AnswerBurst& operator=(const AnswerBurst&) = delete;

  // Puts `send` off, once for each `sender`. False where nothing may be put off on this thread: `send` is the caller's
  // then.
  template <typename Send>
  static bool Later(const void* sender, Send&& send) {
    return here_ != nullptr && here_->Put(sender, std::forward<Send>(send));
  }

 private:
  template <typename Send>
  bool Put(const void* sender, Send&& send) {
    const Clock::time_point now = Clock::now();
    if (waiting_.empty()) since_ = now;
    const bool known =
        std::any_of(waiting_.begin(), waiting_.end(), [&](const auto& one) { return one.first == sender; });
    if (!known) waiting_.emplace_back(sender, std::forward<Send>(send));
    if (now - since_ >= longest_) this->Send();
    return true;
  }
  void Send() {
    const auto waiting = std::exchange(waiting_, {});  // what is sent may end more jobs
    for (const auto& [sender, send] : waiting) send();
  }

  inline static thread_local AnswerBurst* here_ = nullptr;

  const Clock::duration longest_;
  AnswerBurst* const outer_;
  Clock::time_point since_;
  std::vector<std::pair<const void*, std::function<void()>>> waiting_;
};

}  // namespace voxelpipe
