#include "state/full_queue.h"

#include "gtest/gtest.h"
#include "observe/metrics.h"
#include "schedule/scheduler.h"
#include "unit/server/schedule/waiting_task.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;
using testing::MakeTask;

class FullQueueTest : public ::testing::Test {
 protected:
  FullQueueTest() {
    scheduler_.SetDevice(cpu_, 1);
    EXPECT_TRUE(scheduler_.Submit(MakeTask()).ok());
  }
  ~FullQueueTest() override {
    for (auto batch = scheduler_.TryTakeBatch(cpu_); !batch.empty(); batch = scheduler_.TryTakeBatch(cpu_)) {
      scheduler_.Ended(batch);
    }
  }
  static SchedulerOptions Options() {
    SchedulerOptions options;
    options.max_queue = 1;
    options.timer_thread = false;
    return options;
  }

  const WorkerTraits cpu_{"cpu", BackendChoice::kCpu};
  Scheduler scheduler_{Options(), 1};
  Metrics metrics_;
  FullQueue full_{scheduler_, metrics_};
  FullQueue::Clock::time_point now_ = FullQueue::Clock::time_point() + std::chrono::hours(1);
};

TEST_F(FullQueueTest, RefusesOnlyWhileItIsFullAndCounts) {
  EXPECT_EQ(full_.Refusal(now_), nullptr);
  ASSERT_TRUE(scheduler_.Submit(MakeTask()).ok());
  const auto answer = full_.Refusal(now_);
  ASSERT_NE(answer, nullptr);
  EXPECT_EQ(answer->status, scheduler_.FullError());
  const absl::Status told = FromGrpcStatus(answer->grpc_status);
  EXPECT_EQ(told.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(RetryDelay(told), RetryDelay(answer->status));
  EXPECT_EQ(metrics_.Turned(Admission::kJobs).Value(), 1);
  scheduler_.Ended(scheduler_.TryTakeBatch(cpu_));
  EXPECT_EQ(full_.Refusal(now_), nullptr) << "there is room again, however fresh the answer is";
}

TEST_F(FullQueueTest, TheAnswerIsMadeOnceForAMoment) {
  ASSERT_TRUE(scheduler_.Submit(MakeTask()).ok());
  const auto first = full_.Refusal(now_), same = full_.Refusal(now_ + milliseconds(9));
  const auto next = full_.Refusal(now_ + milliseconds(10));
  EXPECT_EQ(first, same);
  EXPECT_NE(first, next);
  EXPECT_EQ(metrics_.Turned(Admission::kJobs).Value(), 3);
}

TEST_F(FullQueueTest, ALineASecondSaysHowManyHadNone) {
  EXPECT_EQ(full_.MayLog(now_), 0u);
  for (int i = 0; i < 7; ++i) EXPECT_EQ(full_.MayLog(now_ + milliseconds(999)), std::nullopt);
  EXPECT_EQ(full_.MayLog(now_ + milliseconds(1000)), 7u);
  EXPECT_EQ(full_.MayLog(now_ + milliseconds(2000)), 0u);
}

}  // namespace
}  // namespace voxelpipe
