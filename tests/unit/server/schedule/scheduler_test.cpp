#include "schedule/scheduler.h"

#include <atomic>
#include <chrono>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "scheduler_fixture.h"
#include "waiting_task.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;
using testing::kCpu;
using testing::kGpu;
using testing::kGpu1;
using testing::MakeTask;
using testing::SchedulerTest;
using testing::Tasks;
using testing::WaitingTask;

TEST_F(SchedulerTest, ABatchEndsWithTheJobsTheTimeOrTheBytesThatItMayHave) {
  options.max_batch_jobs = 4;
  options.max_batch_ms = 10;
  options.max_batch_bytes = 1000;
  Start(1);
  for (int i = 0; i < 6; ++i) Submit();
  EXPECT_EQ(Take().size(), 4u);
  EXPECT_EQ(Take().size(), 2u);
  for (int i = 0; i < 4; ++i) Submit("a", Priority::kNormal, 5);
  EXPECT_EQ(Take().size(), 2u);
  EXPECT_EQ(Take().size(), 2u);
  for (int i = 0; i < 3; ++i) {
    auto task = MakeTask();
    task->traits.cost.output_bytes = 500;
    Submit(task);
  }
  EXPECT_EQ(Take().size(), 2u);
  EXPECT_EQ(Take().size(), 1u);
}

TEST_F(SchedulerTest, ABatchFitsIntoTheDevicesMemory) {
  Start(1);
  WorkerTraits gpu = kGpu;
  gpu.batch_device_bytes = 1000;
  scheduler->SetDevice(gpu, 1);
  for (int i = 0; i < 3; ++i) {
    auto task = MakeTask();
    task->traits.cost.device_bytes = 400;
    Submit(task);
  }
  EXPECT_EQ(Take(gpu).size(), 2u);
  EXPECT_EQ(Take(gpu).size(), 1u);
}

TEST_F(SchedulerTest, SizesAreNotMixedInABatchAndAGiantRunsAlone) {
  options.max_batch_jobs = 64;
  Start(4);
  Submit("a", Priority::kNormal, 1);
  Submit("a", Priority::kNormal, 100);
  Submit("a", Priority::kNormal, 1);
  Submit("a", Priority::kNormal, 5000);
  Submit("a", Priority::kNormal, 5000);
  EXPECT_EQ(Take().size(), 2u) << "the small";
  EXPECT_EQ(Take().size(), 1u) << "the medium";
  EXPECT_EQ(Take().size(), 1u);
  EXPECT_EQ(Take().size(), 1u);
}

TEST_F(SchedulerTest, GiantsLeaveAWorkerToTheSmall) {
  options.max_batch_jobs = 1;
  Start(3);
  std::vector<std::shared_ptr<WaitingTask>> giants;
  for (int i = 0; i < 5; ++i) giants.push_back(Submit("a", Priority::kHigh, 60'000));
  EXPECT_EQ(Take().size(), 1u);
  EXPECT_EQ(Take().size(), 1u);
  EXPECT_TRUE(Take().empty()) << "the third worker is for others";
  const auto small = Submit("b", Priority::kLow, 1);
  EXPECT_EQ(Take(), Tasks{small});
  scheduler->Ended(taken[0]);
  taken.erase(taken.begin());
  EXPECT_EQ(Take(), Tasks{giants[2]}) << "one ended, the next may run";
  Finish();
}

TEST_F(SchedulerTest, TheOnlyWorkerRunsGiantsToo) {
  Start(1);
  const auto giant = Submit("a", Priority::kNormal, 60'000);
  EXPECT_EQ(Take(), Tasks{giant});
}

TEST_F(SchedulerTest, IdleWorkersShareWhatIsThere) {
  Start(2);
  std::vector<Tasks> batches(2);
  std::vector<std::thread> workers;
  for (Tasks& batch : batches) workers.emplace_back([&] { batch = scheduler->TakeBatch(kCpu); });
  while (scheduler->idle() < 2) std::this_thread::yield();
  for (int i = 0; i < 8; ++i) Submit();  // the first one must leave something for the other, or the other never returns
  for (std::thread& worker : workers) worker.join();
  for (const Tasks& batch : batches) taken.push_back(batch);
}

TEST_F(SchedulerTest, ADelayIsForWorkersThatComeFromWorkAndEndsInTime) {
  options.batch_delay = std::chrono::microseconds(2000);
  options.max_batch_jobs = 3;
  Start(1);
  Submit();
  EXPECT_TRUE(Take().empty()) << "more may come";
  now += milliseconds(1);
  Submit();
  EXPECT_TRUE(Take().empty());
  now += milliseconds(1);
  EXPECT_EQ(Take().size(), 2u) << "the time is over";
  Submit();
  Submit();
  EXPECT_TRUE(Take().empty());
  Submit();
  EXPECT_EQ(Take().size(), 3u) << "a full batch waits for nothing";
}

TEST_F(SchedulerTest, WithoutADelayAWorkerTakesWhatIsThere) {
  Start(1);
  Submit();
  EXPECT_EQ(Take().size(), 1u);
}

TEST_F(SchedulerTest, LowTasksAreNotStarvedByAFloodOfHighOnes) {
  options.max_batch_jobs = 1;
  options.aging = milliseconds(1000);
  options.weights = {1e9, 1e4, 1};  // the weights alone would let it wait for ages
  Start(1);
  for (int i = 0; i < 10; ++i) Submit("a", Priority::kHigh, 10);
  const auto first = Submit("b", Priority::kLow, 10);
  while (RunOne() != first) {  // low has used its share for a long time to come
  }
  const auto low = Submit("b", Priority::kLow, 10);
  int waited_ms = 0;
  for (std::shared_ptr<Task> ran; ran != low; waited_ms += 10) {
    ASSERT_LT(waited_ms, 60'000) << "starved";
    Submit("a", Priority::kHigh, 10);
    Submit("a", Priority::kHigh, 10);
    if (scheduler->queued() > 800) break;
    ran = RunOne();
    Pass(milliseconds(10));
  }
  EXPECT_GE(waited_ms, 1000);
  EXPECT_LE(waited_ms, 2 * 1000 + 100) << "two steps up, then its turn among equals";
}

TEST_F(SchedulerTest, AClientWithAThousandTasksDoesNotHoldUpOneWithOne) {
  options.max_batch_jobs = 1;
  options.max_queue = 2000;
  Start(1);
  for (int i = 0; i < 1000; ++i) Submit("greedy");
  for (int i = 0; i < 50; ++i) RunOne();
  const auto one = Submit("modest");
  int before = 0;
  while (RunOne() != one) ++before;
  EXPECT_LE(before, 1);
}

TEST_F(SchedulerTest, RefusesBeyondEachLimitAndSaysWhenToComeAgain) {
  options.max_queue = 2;
  Start(1);
  Submit();
  Take();
  Submit();
  Submit();
  const absl::Status refused = scheduler->Submit(MakeTask());
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_TRUE(RetryDelay(refused).has_value());
  EXPECT_EQ(scheduler->Admit(MakeTask()->traits).code(), absl::StatusCode::kResourceExhausted)
      << "known before anything is uploaded";
}

TEST_F(SchedulerTest, IsFullWhereEveryTaskWouldBeRefused) {
  options.max_queue = 2;
  options.max_batch_jobs = 1;
  Start(1);
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(scheduler->IsFull());
    Submit(i % 2 == 0 ? "a" : "b", Priority::kNormal, 200);
  }
  EXPECT_TRUE(scheduler->IsFull());
  const absl::Status told = scheduler->FullError(), refused = scheduler->Submit(MakeTask("c", Priority::kHigh));
  EXPECT_EQ(told, refused);
  EXPECT_EQ(RetryDelay(told), milliseconds(60));  // a tenth of what waits
  Take();
  EXPECT_TRUE(scheduler->IsFull()) << "the idle worker's place went with it";
  Take();
  EXPECT_FALSE(scheduler->IsFull());
}

// It returns to wait for a worker: a task that took its place meanwhile would exceed the limit.
TEST_F(SchedulerTest, ATaskThatIsBeingLoadedKeepsItsPlace) {
  options.max_queue = 2;
  options.max_batch_jobs = 1;
  options.loaders = 2;
  options.loaders = 2;
  Start(1);
  Submit();
  Take();
  std::vector<std::shared_ptr<WaitingTask>> unloaded;
  for (int i = 0; i < 2; ++i) {
    unloaded.push_back(MakeTask());
    unloaded.back()->is_loaded = false;
    Submit(unloaded.back());
  }
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(scheduler->TakeLoad(), unloaded[i]);
    EXPECT_TRUE(scheduler->IsFull());
    EXPECT_EQ(scheduler->Submit(MakeTask()).code(), absl::StatusCode::kResourceExhausted);
  }
  unloaded[0]->is_loaded = true;
  scheduler->Resubmit(unloaded[0]);
  EXPECT_TRUE(scheduler->IsFull()) << "it waits for the worker now";
  scheduler->Ended(*unloaded[1]);
  EXPECT_FALSE(scheduler->IsFull()) << "a mesh that could not be loaded gives its place back";
  Submit();
  EXPECT_EQ(scheduler->queued(), options.max_queue);
  EXPECT_TRUE(scheduler->IsFull());
}

// A task that keeps so much while it waits, and is predicted to run so long.
auto Holding(uint64_t bytes, double ms) {
  auto task = MakeTask("a", Priority::kNormal, ms);
  task->traits.cost.held_bytes = bytes;
  return task;
}

TEST_F(SchedulerTest, ATaskThatIsBeingLoadedCountsWithItsBytesAndItsTime) {
  options.max_queue_bytes = 100;
  options.max_queue_ms = 1000;
  Start(1);
  Submit();
  Take();
  const auto loading = Holding(60, 900);
  loading->is_loaded = false;
  Submit(loading);
  EXPECT_EQ(scheduler->TakeLoad(), loading);
  EXPECT_FALSE(scheduler->Admit(Holding(60, 1)->traits).ok());
  EXPECT_FALSE(scheduler->Admit(Holding(1, 200)->traits).ok());
  EXPECT_TRUE(scheduler->Admit(Holding(40, 100)->traits).ok());
  scheduler->Ended(*loading);
  EXPECT_TRUE(scheduler->Admit(Holding(60, 200)->traits).ok());
}

TEST_F(SchedulerTest, BytesAndTimeOfWhatWaitsAreBoundedAndGivenBack) {
  options.max_queue_bytes = 100;
  options.max_queue_ms = 1000;
  options.max_batch_jobs = 1;
  Start(1);
  Submit();
  Take();
  const auto first = Submit(Holding(60, 1));
  EXPECT_FALSE(scheduler->Submit(Holding(60, 1)).ok());
  const auto second = Submit(Holding(0, 900));
  EXPECT_FALSE(scheduler->Submit(Holding(0, 200)).ok());
  EXPECT_EQ(scheduler->waiting_bytes(), 60u);
  EXPECT_NEAR(scheduler->waiting_ms(), 901, 1e-6);
  EXPECT_TRUE(scheduler->Withdraw(*second));
  EXPECT_TRUE(scheduler->Withdraw(*first));
  EXPECT_EQ(scheduler->waiting_bytes(), 0u);
  Submit(Holding(60, 200));
}

TEST_F(SchedulerTest, MeasuredTimesCorrectTheBacklog) {
  options.max_batch_jobs = 1;
  Start(1);
  for (int i = 0; i < 200; ++i) {  // each takes four times what was predicted
    Submit("a", Priority::kNormal, 10);
    Take();
    now += milliseconds(40);
    scheduler->Ended(taken.back());
    taken.clear();
  }
  Submit("a", Priority::kNormal, 10);
  EXPECT_NEAR(scheduler->waiting_ms(), 40, 1);
}

TEST_F(SchedulerTest, TasksGoOnlyWhereTheyMay) {
  options.max_batch_jobs = 1;
  Start(1);
  scheduler->SetDevice(kGpu, 1);
  auto only_gpu = MakeTask();
  only_gpu->traits.backend = BackendChoice::kCuda;
  only_gpu->traits.fallback = false;
  Submit(only_gpu);
  auto prefers_gpu = MakeTask();
  prefers_gpu->traits.backend = BackendChoice::kCuda;
  Submit(prefers_gpu);
  EXPECT_TRUE(Take(kCpu).empty());
  scheduler->SetDevice(kGpu, 0);
  EXPECT_EQ(Take(kCpu), Tasks{prefers_gpu}) << "no GPU is left";
  EXPECT_TRUE(Take(kCpu).empty());
  EXPECT_TRUE(Take(kGpu).empty()) << "it does not serve";
  EXPECT_EQ(scheduler->TakeStranded(), Tasks{only_gpu});
  EXPECT_EQ(scheduler->queued(), 0u);
}

TEST_F(SchedulerTest, AFailedTaskIsNextOnAnotherDevice) {
  options.max_batch_jobs = 1;
  Start(1);
  scheduler->SetDevice(kGpu, 1);
  scheduler->SetDevice(kGpu1, 1);
  for (int i = 0; i < 4; ++i) Submit();
  const std::shared_ptr<Task> failed = Take(kGpu)[0];
  taken.clear();
  failed->traits.excluded_devices = {"cuda:0"};
  scheduler->Resubmit(failed);
  EXPECT_NE(Take(kGpu)[0], failed);
  EXPECT_EQ(Take(kGpu1)[0], failed);
}

TEST_F(SchedulerTest, DrainWaitsForAllThatWasAcceptedAndRefusesMore) {
  Start(1);
  for (int i = 0; i < 10; ++i) Submit();
  std::atomic<bool> drained = false;
  std::thread waiter([&] {
    scheduler->Drain();
    drained = true;
  });
  // Which it does only once Drain began.
  while (!absl::IsUnavailable(scheduler->Submit(MakeTask()))) std::this_thread::yield();
  EXPECT_FALSE(drained);
  Finish();
  waiter.join();
}

// Threads that submit, withdraw, work, fail, and a timer: everything ends exactly once. For the sanitizers, too.
TEST_F(SchedulerTest, EverythingEndsOnceUnderLoad) {
  class Counted final : public Task {
   public:
    explicit Counted(std::atomic<int>& ended) : ended_(ended) {}
    bool loaded() const override { return is_loaded; }
    bool Load() override { return is_loaded = true; }
    void Refuse(absl::Status) override { End(); }
    void End() {
      EXPECT_FALSE(std::exchange(over_, true));
      ++ended_;
    }
    bool is_loaded = true, failed = false;

   private:
    std::atomic<int>& ended_;
    bool over_ = false;
  };
  options.now = {};
  options.timer_thread = true;
  options.max_queue = 500;
  options.batch_delay = std::chrono::microseconds(50);
  options.aging = milliseconds(1);
  options.loaders = 2;
  Start(3);
  std::atomic<int> ended = 0, submitted = 0;
  std::vector<std::thread> workers, clients;
  for (int i = 0; i < 3; ++i) {
    workers.emplace_back([&] {
      while (true) {
        const Tasks batch = scheduler->TakeBatch(kCpu);
        if (batch.empty()) return;
        Tasks done;
        for (const auto& task : batch) {
          auto& counted = static_cast<Counted&>(*task);
          if (std::exchange(counted.failed, false)) {
            scheduler->Resubmit(task);
            continue;
          }
          counted.End();
          done.push_back(task);
        }
        scheduler->Ended(done);
      }
    });
  }
  for (int i = 0; i < 2; ++i) {
    workers.emplace_back([&] {
      while (auto task = scheduler->TakeLoad()) {
        task->Load();
        scheduler->Resubmit(std::move(task));
      }
    });
  }
  for (int c = 0; c < 4; ++c) {
    clients.emplace_back([&, c] {
      for (int i = 0; i < 2000; ++i) {
        auto task = std::make_shared<Counted>(ended);
        task->traits.client = std::string(1, char('a' + c));
        task->traits.priority = Priority(i % 3);
        task->traits.cost.run_ms = i % 97 == 0 ? 2000 : 0.1 * (i % 5);
        task->traits.cost.held_bytes = 10;
        if (i % 7 == 0) task->traits.queue_timeout = milliseconds(i % 3 + 1);
        task->is_loaded = i % 5 != 0;
        task->failed = i % 11 == 0;
        if (!scheduler->Submit(task).ok()) continue;
        ++submitted;
        if (i % 13 == 0 && scheduler->Withdraw(*task)) task->End();
      }
    });
  }
  for (std::thread& client : clients) client.join();
  scheduler->Drain();
  scheduler->Stop();
  for (std::thread& worker : workers) worker.join();
  EXPECT_EQ(ended, submitted);
  EXPECT_EQ(scheduler->queued(), 0u);
  EXPECT_EQ(scheduler->running(), 0u);
  EXPECT_EQ(scheduler->waiting_bytes(), 0u);
}

}  // namespace
}  // namespace voxelpipe
