// What one client takes, against what it may take.
#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>

#include "access/tokens.h"

namespace voxelpipe {

using QuotaClock = std::chrono::steady_clock;

// Tokens that fill up steadily; taking one that is not there returns when it will be. Not thread-safe.
class TokenBucket {
 public:
  // Full at the start. `per_second` above 0, `size` at least 1.
  TokenBucket(double per_second, double size, QuotaClock::time_point now);
  // Other limits from now on; what is there stays, as far as it fits.
  void SetLimits(double per_second, double size, QuotaClock::time_point now);
  // Takes `count` and returns 0, or leaves all and returns how long to wait. A count beyond the bucket's size is taken
  // from a full one, which is then in debt.
  std::chrono::milliseconds Take(double count, QuotaClock::time_point now);

 private:
  void Fill(QuotaClock::time_point now);

  double per_second_, size_, level_;
  QuotaClock::time_point filled_;
};

struct QuotaRefusal {
  Refusal reason;
  std::chrono::milliseconds retry_after;
};

// One client's. Thread-safe.
class Quota {
 public:
  static constexpr uint32_t kMaxAnswered = 64;

  explicit Quota(const QuotaLimits& limits);

  void SetLimits(const QuotaLimits& limits, QuotaClock::time_point now);
  // One call begins, or why not. Each that began must End.
  std::optional<QuotaRefusal> Begin(QuotaClock::time_point now);
  // One more piece of work within a call that began, which counts for calls a second alone; or why not.
  std::optional<QuotaRefusal> TakeCall(QuotaClock::time_point now);
  // One that began is answered: its client may begin the next one before this one has ended. Of such calls kMaxAnswered
  // more than may be at once do not count, so that clients that take no answer do not pile up.
  void Answered();
  void End(bool answered);
  // `bytes` of a mesh came, or why they are too many.
  std::optional<QuotaRefusal> TakeBytes(uint64_t bytes, QuotaClock::time_point now);

 private:
  std::mutex mutex_;
  QuotaLimits limits_;
  std::optional<TokenBucket> calls_, bytes_;
  uint32_t calls_now_ = 0, answered_now_ = 0;  // the second ones are among the first
};

}  // namespace voxelpipe
