#include "access/quotas.h"

#include <algorithm>
#include <cmath>

namespace voxelpipe {
namespace {

// The retry delay of a client with too many concurrent calls: about one small job.
constexpr std::chrono::milliseconds kCallsAtOnceRetry{200};

void SetBucket(std::optional<TokenBucket>& bucket, double per_second, double burst, QuotaClock::time_point now) {
  if (per_second <= 0) {
    bucket.reset();
    return;
  }
  const double size = std::max(1., burst > 0 ? burst : per_second);
  if (bucket) {
    bucket->SetLimits(per_second, size, now);
  } else {
    bucket.emplace(per_second, size, now);
  }
}

}  // namespace

TokenBucket::TokenBucket(double per_second, double size, QuotaClock::time_point now)
    : per_second_(per_second), size_(size), level_(size), filled_(now) {}

void TokenBucket::SetLimits(double per_second, double size, QuotaClock::time_point now) {
  Fill(now);
  per_second_ = per_second;
  size_ = size;
  level_ = std::min(level_, size_);
}

void TokenBucket::Fill(QuotaClock::time_point now) {
  if (now <= filled_) return;
  level_ = std::min(size_, level_ + std::chrono::duration<double>(now - filled_).count() * per_second_);
  filled_ = now;
}

std::chrono::milliseconds TokenBucket::Take(double count, QuotaClock::time_point now) {
  const std::chrono::milliseconds wait = WaitFor(count, now);
  if (wait.count() == 0) level_ -= count;
  return wait;
}

std::chrono::milliseconds TokenBucket::WaitFor(double count, QuotaClock::time_point now) {
  Fill(now);
  const double needed = std::min(count, size_);
  if (level_ + 1e-9 < needed) {
    const double seconds = std::min((needed - level_) / per_second_, 3600.);
    return std::chrono::milliseconds(std::max<int64_t>(1, int64_t(std::ceil(seconds * 1000 - 1e-6))));
  }
  return std::chrono::milliseconds(0);
}

Quota::Quota(const QuotaLimits& limits) {
  SetLimits(limits, QuotaClock::time_point());
}

void Quota::SetLimits(const QuotaLimits& limits, QuotaClock::time_point now) {
  const std::lock_guard lock(mutex_);
  limits_ = limits;
  SetBucket(calls_, limits.calls_per_second, limits.burst_calls, now);
  SetBucket(bytes_, double(limits.bytes_per_second), double(limits.burst_bytes), now);
}

std::optional<QuotaRefusal> Quota::CheckLocked(QuotaClock::time_point now) {
  const uint32_t counted = std::max(calls_now_ - answered_now_, calls_now_ - std::min(calls_now_, kMaxAnswered));
  if (limits_.calls_at_once != 0 && counted >= limits_.calls_at_once) {
    return QuotaRefusal{Refusal::kQuotaCalls, kCallsAtOnceRetry};
  }
  if (calls_) {
    if (const auto wait = calls_->WaitFor(1, now); wait.count() > 0) return QuotaRefusal{Refusal::kQuotaRate, wait};
  }
  return std::nullopt;
}

std::optional<QuotaRefusal> Quota::Check(QuotaClock::time_point now) {
  const std::lock_guard lock(mutex_);
  return CheckLocked(now);
}

std::optional<QuotaRefusal> Quota::Begin(QuotaClock::time_point now) {
  const std::lock_guard lock(mutex_);
  if (std::optional<QuotaRefusal> refusal = CheckLocked(now)) return refusal;
  if (calls_) calls_->Take(1, now);
  ++calls_now_;
  return std::nullopt;
}

std::optional<QuotaRefusal> Quota::TakeCall(QuotaClock::time_point now) {
  const std::lock_guard lock(mutex_);
  if (!calls_) return std::nullopt;
  if (const auto wait = calls_->Take(1, now); wait.count() > 0) return QuotaRefusal{Refusal::kQuotaRate, wait};
  return std::nullopt;
}

void Quota::Answered() {
  const std::lock_guard lock(mutex_);
  ++answered_now_;
}

void Quota::End(bool answered) {
  const std::lock_guard lock(mutex_);
  --calls_now_;
  if (answered) --answered_now_;
}

std::optional<QuotaRefusal> Quota::TakeBytes(uint64_t bytes, QuotaClock::time_point now) {
  const std::lock_guard lock(mutex_);
  if (!bytes_ || bytes == 0) return std::nullopt;
  if (const auto wait = bytes_->Take(double(bytes), now); wait.count() > 0) {
    return QuotaRefusal{Refusal::kQuotaBytes, wait};
  }
  return std::nullopt;
}

}  // namespace voxelpipe
