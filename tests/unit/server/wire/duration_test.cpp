#include "wire/duration.h"

#include <cmath>
#include <cstdint>
#include <limits>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using google::protobuf::Duration;
using std::chrono::milliseconds;

Duration Of(int64_t seconds, int32_t nanos) {
  Duration time;
  time.set_seconds(seconds);
  time.set_nanos(nanos);
  return time;
}

TEST(DurationTest, MillisecondsSurvive) {
  for (const double ms : {0.0, 0.25, 1.5, 999.999, 1000.0, 86'400'000.5}) {
    Duration time;
    WriteMs(ms, time);
    EXPECT_DOUBLE_EQ(MsOf(time), ms);
    EXPECT_LT(time.nanos(), 1'000'000'000);
  }
  Duration time;
  WriteTo(milliseconds(1250), time);
  EXPECT_EQ(time.seconds(), 1);
  EXPECT_EQ(time.nanos(), 250'000'000);
  EXPECT_EQ(ReadTimeout(time, "timeout").value(), milliseconds(1250));
}

TEST(DurationTest, WhatIsNoTimeIsNone) {
  for (const double ms : {-1.0, std::nan(""), -std::numeric_limits<double>::infinity()}) {
    Duration time;
    WriteMs(ms, time);
    EXPECT_EQ(MsOf(time), 0) << ms;
  }
  Duration longest;
  WriteMs(std::numeric_limits<double>::infinity(), longest);
  EXPECT_TRUE(std::isfinite(MsOf(longest)));
}

TEST(DurationTest, ATimeOutIsAtMostAYearAndNotNegative) {
  EXPECT_EQ(ReadTimeout(Of(0, 0), "timeout").value(), milliseconds(0));
  EXPECT_EQ(ReadTimeout(Of(0, 999'999), "timeout").value(), milliseconds(0));
  EXPECT_EQ(ReadTimeout(Of(std::numeric_limits<int64_t>::max(), 0), "timeout").value(), std::chrono::hours(365 * 24));
  for (const Duration& wrong : {Of(-1, 0), Of(0, -1), Of(5, -1)}) {
    EXPECT_EQ(ReadTimeout(wrong, "queue_timeout").status(),
              absl::InvalidArgumentError("queue_timeout: must not be negative"));
  }
}

}  // namespace
}  // namespace voxelpipe
