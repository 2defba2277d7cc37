// Quotas: the use of one client against its limits.
#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>

#include "access/tokens.h"

namespace voxelpipe {

using QuotaClock = std::chrono::steady_clock;

// A token bucket; taking tokens that are not available returns the waiting time. Not thread-safe.
class TokenBucket {
 public:
  // Full at the start. `per_second` above 0, `size` at least 1.
  TokenBucket(double per_second, double size, QuotaClock::time_point now);
  // Changes the limits; keeps the tokens up to the new size.
  void SetLimits(double per_second, double size, QuotaClock::time_point now);
  // Takes `count` and returns 0, or takes nothing and returns the waiting time. A count beyond the bucket's size is
  // taken from a full bucket, which then has a negative count.
  std::chrono::milliseconds Take(double count, QuotaClock::time_point now);
  // The waiting time that Take would return now; 0 if it would take them.
  std::chrono::milliseconds WaitFor(double count, QuotaClock::time_point now);

 private:
  void Fill(QuotaClock::time_point now);

  double per_second_, size_, level_;
  QuotaClock::time_point filled_;
};

struct QuotaRefusal {
  Refusal reason;
  std::chrono::milliseconds retry_after;
};

// The quotas of one client. Thread-safe.
class Quota {
 public:
  static constexpr uint32_t kMaxAnswered = 64;

  explicit Quota(const QuotaLimits& limits);

  void SetLimits(const QuotaLimits& limits, QuotaClock::time_point now);
  // Begins a call, or returns why not. Each call that began must End.
  std::optional<QuotaRefusal> Begin(QuotaClock::time_point now);
  // Why a call could not begin now, if so; begins none.
  std::optional<QuotaRefusal> Check(QuotaClock::time_point now);
  // Begins a job within a call, which counts only for calls a second; or returns why not.
  std::optional<QuotaRefusal> TakeCall(QuotaClock::time_point now);
  // A call is answered: its client may begin the next one before this one has ended. Up to kMaxAnswered answered calls
  // do not count as concurrent; more do, so that clients that do not read their responses cannot accumulate calls.
  void Answered();
  void End(bool answered);
  // Charges `bytes` of a mesh, or returns why not.
  std::optional<QuotaRefusal> TakeBytes(uint64_t bytes, QuotaClock::time_point now);

 private:
  std::optional<QuotaRefusal> CheckLocked(QuotaClock::time_point now);

  std::mutex mutex_;
  QuotaLimits limits_;
  std::optional<TokenBucket> calls_, bytes_;
  uint32_t calls_now_ = 0, answered_now_ = 0;  // answered calls are included in calls_now_
};

}  // namespace voxelpipe
