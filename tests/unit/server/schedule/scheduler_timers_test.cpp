// Time-outs and deadlines in the queue.
#include <chrono>
#include <latch>
#include <memory>
#include <string>

#include "gtest/gtest.h"
#include "schedule/scheduler.h"
#include "scheduler_fixture.h"
#include "waiting_task.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;
using testing::MakeTask;
using testing::SchedulerTest;
using testing::Tasks;

TEST_F(SchedulerTest, AQueueTimeOutEndsATaskThoughEveryWorkerIsBusy) {
  options.max_batch_jobs = 1;
  Start(1);
  Submit();
  Take();
  auto task = MakeTask();
  task->traits.queue_timeout = milliseconds(30);
  Submit(task);
  Pass(milliseconds(29));
  EXPECT_TRUE(task->refused.empty());
  Pass(milliseconds(1));
  ASSERT_EQ(task->refused.size(), 1u);
  EXPECT_EQ(task->refused[0].code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_NE(std::string(task->refused[0].message()).find("waited 30 ms in the queue"), std::string::npos)
      << task->refused[0];
  EXPECT_EQ(scheduler->queued(), 0u);
  EXPECT_FALSE(scheduler->Withdraw(*task));
  Pass(milliseconds(1000));
  EXPECT_EQ(task->refused.size(), 1u) << "once";
}

TEST_F(SchedulerTest, ADeadlineThatPassesInTheQueueEndsATask) {
  options.max_batch_jobs = 1;
  Start(1);
  Submit();
  Take();
  auto task = MakeTask();
  task->traits.deadline = now + milliseconds(20);
  task->traits.queue_timeout = milliseconds(500);
  Submit(task);
  Pass(milliseconds(20));
  ASSERT_EQ(task->refused.size(), 1u);
  EXPECT_EQ(task->refused[0].code(), absl::StatusCode::kDeadlineExceeded);
}

TEST_F(SchedulerTest, ATimeOutIsOverOnceAWorkerHasTheTask) {
  Start(1);
  auto task = MakeTask();
  task->traits.queue_timeout = milliseconds(30);
  Submit(task);
  EXPECT_EQ(Take(), Tasks{task});
  Pass(milliseconds(100));
  EXPECT_TRUE(task->refused.empty());
  scheduler->Resubmit(task);  // its worker failed
  taken.clear();
  Pass(milliseconds(100));
  EXPECT_TRUE(task->refused.empty()) << "it had its turn";
}

TEST_F(SchedulerTest, TheServersTimeOutIsForTasksThatDoNotSay) {
  options.queue_timeout = milliseconds(10);
  options.max_batch_jobs = 1;
  Start(1);
  Submit();
  Take();
  const auto silent = Submit();
  auto patient = MakeTask();
  patient->traits.queue_timeout = milliseconds(0);
  Submit(patient);
  Pass(milliseconds(10));
  EXPECT_EQ(silent->refused.size(), 1u);
  EXPECT_TRUE(patient->refused.empty()) << "0 is no limit";
}

TEST_F(SchedulerTest, TimeSpentLoadingIsNotSpentWaiting) {
  Start(1);
  auto task = MakeTask();
  task->is_loaded = false;
  task->traits.queue_timeout = milliseconds(30);
  Submit(task);
  now += milliseconds(10);
  EXPECT_EQ(scheduler->TakeLoad(), task);
  Pass(milliseconds(1000));
  task->is_loaded = true;
  scheduler->Resubmit(task);
  Pass(milliseconds(19));
  EXPECT_TRUE(task->refused.empty());
  Pass(milliseconds(1));
  EXPECT_EQ(task->refused.size(), 1u);
}

TEST_F(SchedulerTest, TheTimerThreadWakesByItself) {
  options.now = {};
  options.timer_thread = true;
  options.max_batch_jobs = 1;
  Start(1);
  Submit();
  Take();
  class Told final : public Task {
   public:
    bool loaded() const override { return true; }
    bool Load() override { return true; }
    void Refuse(absl::Status) override { told.count_down(); }
    std::latch told{1};
  };
  auto task = std::make_shared<Told>();
  task->traits.queue_timeout = milliseconds(1);
  ASSERT_TRUE(scheduler->Submit(task).ok());
  task->told.wait();
}

}  // namespace
}  // namespace voxelpipe
