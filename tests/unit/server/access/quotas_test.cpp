#include "access/quotas.h"

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

const QuotaClock::time_point kStart = QuotaClock::time_point() + std::chrono::hours(1000);

TEST(QuotasTest, ABucketGivesItsBurstAndThenItsRate) {
  TokenBucket bucket(10, 3, kStart);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(bucket.Take(1, kStart), milliseconds(0));
  EXPECT_EQ(bucket.Take(1, kStart), milliseconds(100));
  EXPECT_EQ(bucket.Take(1, kStart + milliseconds(99)), milliseconds(1));
  EXPECT_EQ(bucket.Take(1, kStart + milliseconds(100)), milliseconds(0));
  // A long pause fills it to its size, and no further.
  for (int i = 0; i < 3; ++i) EXPECT_EQ(bucket.Take(1, kStart + seconds(60)), milliseconds(0));
  EXPECT_GT(bucket.Take(1, kStart + seconds(60)), milliseconds(0));
}

TEST(QuotasTest, MoreThanABucketHoldsIsTakenFromAFullOneAndPaidAfterwards) {
  TokenBucket bucket(100, 100, kStart);
  EXPECT_EQ(bucket.Take(300, kStart), milliseconds(0));
  EXPECT_EQ(bucket.Take(1, kStart), milliseconds(2010));
  EXPECT_EQ(bucket.Take(1, kStart + milliseconds(2010)), milliseconds(0));
}

TEST(QuotasTest, AClockThatGoesBackFillsNothing) {
  TokenBucket bucket(10, 1, kStart);
  EXPECT_EQ(bucket.Take(1, kStart), milliseconds(0));
  EXPECT_EQ(bucket.Take(1, kStart - seconds(10)), milliseconds(100));
}

TEST(QuotasTest, CallsAtOnceAreCountedAndGivenBack) {
  Quota quota({.calls_per_second = 0, .burst_calls = 0, .calls_at_once = 2, .bytes_per_second = 0, .burst_bytes = 0});
  EXPECT_FALSE(quota.Begin(kStart));
  EXPECT_FALSE(quota.Begin(kStart));
  const auto refusal = quota.Begin(kStart);
  ASSERT_TRUE(refusal);
  EXPECT_EQ(refusal->reason, Refusal::kQuotaCalls);
  EXPECT_GT(refusal->retry_after, milliseconds(0));
  quota.End(false);
  EXPECT_FALSE(quota.Begin(kStart));
}

TEST(QuotasTest, AJobOfAStreamCountsForTheRateAndNotForCallsAtOnce) {
  Quota quota({.calls_per_second = 1, .burst_calls = 3, .calls_at_once = 1, .bytes_per_second = 0, .burst_bytes = 0});
  EXPECT_FALSE(quota.Begin(kStart));
  EXPECT_FALSE(quota.TakeCall(kStart));
  EXPECT_FALSE(quota.TakeCall(kStart));
  const auto refusal = quota.TakeCall(kStart);
  ASSERT_TRUE(refusal);
  EXPECT_EQ(refusal->reason, Refusal::kQuotaRate);
  EXPECT_EQ(refusal->retry_after, seconds(1));
  quota.End(false);
  EXPECT_TRUE(quota.Begin(kStart)) << "single calls have the same quota";
  EXPECT_FALSE(quota.Begin(kStart + seconds(1)));
}

TEST(QuotasTest, AnAnsweredCallGivesItsPlaceBeforeItEnds) {
  Quota quota({.calls_per_second = 0, .burst_calls = 0, .calls_at_once = 1, .bytes_per_second = 0, .burst_bytes = 0});
  EXPECT_FALSE(quota.Begin(kStart));
  EXPECT_TRUE(quota.Begin(kStart));
  quota.Answered();
  EXPECT_FALSE(quota.Begin(kStart));
  EXPECT_TRUE(quota.Begin(kStart)) << "the second one is not answered";
  quota.End(true);
  EXPECT_TRUE(quota.Begin(kStart));
  quota.End(false);
  EXPECT_FALSE(quota.Begin(kStart));
}

TEST(QuotasTest, CallsWhoseAnswersNobodyTakesDoNotPileUp) {
  Quota quota({.calls_per_second = 0, .burst_calls = 0, .calls_at_once = 2, .bytes_per_second = 0, .burst_bytes = 0});
  uint32_t begun = 0;
  for (; begun < 1000 && !quota.Begin(kStart); ++begun) quota.Answered();
  EXPECT_EQ(begun, 2 + Quota::kMaxAnswered);
  quota.End(true);
  EXPECT_FALSE(quota.Begin(kStart));
}

TEST(QuotasTest, ACallThatIsRefusedForItsRateTakesNoPlace) {
  Quota quota({.calls_per_second = 1, .burst_calls = 1, .calls_at_once = 2, .bytes_per_second = 0, .burst_bytes = 0});
  EXPECT_FALSE(quota.Begin(kStart));
  EXPECT_EQ(quota.Begin(kStart)->reason, Refusal::kQuotaRate);
  EXPECT_EQ(quota.Begin(kStart)->retry_after, seconds(1));
  EXPECT_FALSE(quota.Begin(kStart + seconds(1)));
  EXPECT_EQ(quota.Begin(kStart + seconds(2))->reason, Refusal::kQuotaCalls);
}

TEST(QuotasTest, BytesHaveTheirOwnRate) {
  Quota quota(
      {.calls_per_second = 0, .burst_calls = 0, .calls_at_once = 0, .bytes_per_second = 1000, .burst_bytes = 0});
  EXPECT_FALSE(quota.TakeBytes(1000, kStart));
  const auto refusal = quota.TakeBytes(500, kStart);
  ASSERT_TRUE(refusal);
  EXPECT_EQ(refusal->reason, Refusal::kQuotaBytes);
  EXPECT_EQ(refusal->retry_after, milliseconds(500));
  EXPECT_FALSE(quota.TakeBytes(0, kStart));
}

TEST(QuotasTest, NewLimitsHoldAtOnceAndGiveNothingBack) {
  Quota quota({.calls_per_second = 1, .burst_calls = 1, .calls_at_once = 0, .bytes_per_second = 0, .burst_bytes = 0});
  EXPECT_FALSE(quota.Begin(kStart));
  quota.SetLimits(
      {.calls_per_second = 10, .burst_calls = 1, .calls_at_once = 0, .bytes_per_second = 0, .burst_bytes = 0}, kStart);
  EXPECT_EQ(quota.Begin(kStart)->retry_after, milliseconds(100));
  quota.SetLimits({}, kStart);
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(quota.Begin(kStart));
}

}  // namespace
}  // namespace voxelpipe
