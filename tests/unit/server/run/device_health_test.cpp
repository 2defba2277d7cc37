#include "run/device_health.h"

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;

class DeviceHealthTest : public ::testing::Test {
 protected:
  bool Fail(DeviceFailureKind kind, const char* reason = "it broke") { return health_.Failed(kind, reason, now_); }
  // Goes to the next probe and gives it this end.
  bool Probe(const absl::Status& outcome) {
    EXPECT_TRUE(health_.next_probe().has_value());
    now_ = health_.next_probe().value_or(now_);
    EXPECT_TRUE(health_.BeginProbe(now_));
    return health_.Probed(outcome, now_);
  }

  DeviceHealth::Time now_{std::chrono::hours(5)};
  DeviceHealth health_{{.probe_interval = milliseconds(1000), .max_probe_interval = milliseconds(60'000)}};
};

TEST_F(DeviceHealthTest, ALostDeviceLeavesServiceAtOnce) {
  EXPECT_TRUE(health_.serving());
  EXPECT_TRUE(Fail(DeviceFailureKind::kLost, "fell off the bus"));
  EXPECT_EQ(health_.state(), DeviceState::kQuarantined);
  EXPECT_EQ(health_.reason(), "fell off the bus");
  EXPECT_EQ(health_.since(), now_);
  EXPECT_EQ(health_.next_probe(), now_ + milliseconds(1000));
}

TEST_F(DeviceHealthTest, OneErrorIsForgivenTwoInARowAreNot) {
  EXPECT_FALSE(Fail(DeviceFailureKind::kError));
  health_.Succeeded();
  EXPECT_FALSE(Fail(DeviceFailureKind::kError));
  EXPECT_TRUE(health_.serving());
  EXPECT_TRUE(Fail(DeviceFailureKind::kError));
  EXPECT_FALSE(health_.serving());
}

TEST_F(DeviceHealthTest, OutOfMemoryIsNoReason) {
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(Fail(DeviceFailureKind::kOutOfMemory));
  EXPECT_TRUE(health_.serving());
  EXPECT_FALSE(Fail(DeviceFailureKind::kError)) << "it does not count as an error before";
}

TEST_F(DeviceHealthTest, OnlyTheFirstFailureIsToldOthersThatRanThenAddNothing) {
  EXPECT_TRUE(Fail(DeviceFailureKind::kLost, "first"));
  EXPECT_FALSE(Fail(DeviceFailureKind::kLost, "second"));
  EXPECT_EQ(health_.reason(), "first");
}

TEST_F(DeviceHealthTest, NoProbeBeforeItIsDueAndNotTwoAtOnce) {
  EXPECT_FALSE(health_.BeginProbe(now_)) << "it serves";
  Fail(DeviceFailureKind::kLost);
  EXPECT_FALSE(health_.BeginProbe(now_ + milliseconds(999)));
  EXPECT_TRUE(health_.BeginProbe(now_ + milliseconds(1000)));
  EXPECT_EQ(health_.state(), DeviceState::kProbing);
  EXPECT_FALSE(health_.next_probe().has_value());
  EXPECT_FALSE(health_.BeginProbe(now_ + milliseconds(5000)));
}

TEST_F(DeviceHealthTest, AGoodProbeBringsItBack) {
  Fail(DeviceFailureKind::kLost);
  EXPECT_TRUE(Probe(absl::OkStatus()));
  EXPECT_TRUE(health_.serving());
  EXPECT_EQ(health_.reason(), "");
  EXPECT_EQ(health_.since(), now_);
  EXPECT_FALSE(Fail(DeviceFailureKind::kError)) << "errors are counted anew";
}

TEST_F(DeviceHealthTest, ProbesThatFailComeHalfAsOftenDownToALimit) {
  Fail(DeviceFailureKind::kLost);
  DeviceHealth::Time before = now_;
  for (const int expected : {1000, 2000, 4000, 8000, 16000, 32000, 60000, 60000}) {
    EXPECT_FALSE(Probe(absl::InternalError("still broken")));
    EXPECT_EQ(now_ - before, milliseconds(expected));
    EXPECT_EQ(health_.reason(), "still broken");
    before = now_;
  }
  EXPECT_TRUE(Probe(absl::OkStatus()));
}

TEST_F(DeviceHealthTest, ADeviceThatFailsAgainSoonKeepsItsLongIntervals) {
  Fail(DeviceFailureKind::kLost);
  for (int i = 0; i < 3; ++i) Probe(absl::InternalError("still broken"));
  EXPECT_TRUE(Probe(absl::OkStatus()));
  now_ += milliseconds(100);
  Fail(DeviceFailureKind::kLost);
  EXPECT_EQ(health_.next_probe(), now_ + milliseconds(16000));
}

TEST_F(DeviceHealthTest, ADeviceThatServedForLongStartsAnew) {
  Fail(DeviceFailureKind::kLost);
  for (int i = 0; i < 3; ++i) Probe(absl::InternalError("still broken"));
  EXPECT_TRUE(Probe(absl::OkStatus()));
  now_ += milliseconds(60'001);
  Fail(DeviceFailureKind::kLost);
  EXPECT_EQ(health_.next_probe(), now_ + milliseconds(1000));
}

}  // namespace
}  // namespace voxelpipe
