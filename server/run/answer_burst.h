// Defers the responses of one thread, so that several are sent together.
#pragma once

#include <algorithm>
#include <chrono>
#include <functional>
#include <utility>
#include <vector>

namespace voxelpipe {

// During its lifetime, the responses of its thread may wait for later ones and be sent together, because a message
// costs as much as a small job. At most for `longest`, checked whenever a response is deferred.
class AnswerBurst {
 public:
  using Clock = std::chrono::steady_clock;

  explicit AnswerBurst(Clock::duration longest) : longest_(longest), outer_(std::exchange(here_, this)) {}
  // Runs the deferred functions.
  ~AnswerBurst() {
    here_ = outer_;
    Send();
  }
  AnswerBurst(const AnswerBurst&) = delete;
  AnswerBurst& operator=(const AnswerBurst&) = delete;

  // Defers `send`, once for each `sender`. False if this thread defers nothing: the caller must call `send`.
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
    const auto waiting = std::exchange(waiting_, {});  // sending may end more jobs
    for (const auto& [sender, send] : waiting) send();
  }

  inline static thread_local AnswerBurst* here_ = nullptr;

  const Clock::duration longest_;
  AnswerBurst* const outer_;
  Clock::time_point since_;
  std::vector<std::pair<const void*, std::function<void()>>> waiting_;
};

}  // namespace voxelpipe
