// Which kind of device takes a task that leaves it open.
#include <atomic>
#include <chrono>
#include <thread>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "schedule/scheduler.h"
#include "scheduler_fixture.h"
#include "waiting_task.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;
using testing::kCpu;
using testing::kGpu;
using testing::MakeTask;
using testing::SchedulerTest;
using testing::Tasks;

// With devices whose speed the scheduler has seen.
class AutoTest : public SchedulerTest {
 protected:
  // Runs of each kind that took so long for a predicted millisecond.
  void Learn(double cpu_ms, double gpu_ms) {
    options.max_batch_jobs = 1;
    Start(1);
    scheduler->SetDevice(kGpu, 1);
    for (int i = 0; i < 200; ++i) {
      for (const auto& [worker, ms] : {std::pair{kCpu, cpu_ms}, std::pair{kGpu, gpu_ms}}) {
        auto task = MakeTask();
        task->traits.backend = worker.kind;
        Submit(task);
        Run(worker, ms);
      }
    }
  }
  void Run(const WorkerTraits& worker, double ms) {
    ASSERT_EQ(Take(worker).size(), 1u);
    now += std::chrono::duration_cast<JobContext::Clock::duration>(std::chrono::duration<double, std::milli>(ms));
    scheduler->Ended(taken.back());
    taken.clear();
  }
};

TEST_F(AutoTest, AnIdleCpuHasWhatItEndsEarlier) {
  Learn(/*cpu_ms=*/1, /*gpu_ms=*/5);
  const auto task = Submit();
  EXPECT_TRUE(Take(kGpu).empty());
  EXPECT_EQ(Take(kCpu), Tasks{task});
  const auto next = Submit();
  EXPECT_EQ(Take(kGpu), Tasks{next}) << "the CPU is busy";
}

TEST_F(AutoTest, AnIdleGpuHasWhatItEndsEarlier) {
  Learn(/*cpu_ms=*/5, /*gpu_ms=*/1);
  const auto task = Submit();
  EXPECT_TRUE(Take(kCpu).empty());
  EXPECT_EQ(Take(kGpu), Tasks{task});
}

TEST_F(AutoTest, TheCpuHelpsABusyGpuAsSoonAsItEndsEarlier) {
  Learn(/*cpu_ms=*/5, /*gpu_ms=*/1);
  const auto running = Submit("a", Priority::kNormal, 12);
  EXPECT_EQ(Take(kGpu), Tasks{running});  // for 12 ms
  const auto small = Submit();
  EXPECT_EQ(Take(kCpu), Tasks{small}) << "5 ms here, after 13 there";
  const auto waiting = Submit("a", Priority::kNormal, 4);
  EXPECT_TRUE(Take(kCpu).empty()) << "20 ms here, after 16 there";
  now += milliseconds(40);  // the GPU's batch takes far longer than was thought
  EXPECT_EQ(Take(kCpu), Tasks{waiting});
}

TEST_F(AutoTest, OneKindAloneTakesAll) {
  Learn(/*cpu_ms=*/50, /*gpu_ms=*/1);
  const auto task = Submit();
  EXPECT_TRUE(Take(kCpu).empty());
  scheduler->SetDevice(kGpu, 0);
  EXPECT_EQ(Take(kCpu), Tasks{task});
}

// With real threads: wakes the worker that is the better choice, and only that one.
TEST(AutoWorkersTest, EveryTaskIsTakenByOneOfBoth) {
  SchedulerOptions options;
  options.max_batch_jobs = 4;
  Scheduler scheduler(options, 2);
  scheduler.SetDevice(kCpu, 1);
  scheduler.SetDevice(kGpu, 1);
  std::atomic<int> done = 0;
  std::vector<std::thread> workers;
  for (const WorkerTraits* worker : {&kCpu, &kGpu}) {
    workers.emplace_back([&scheduler, &done, worker] {
      for (Tasks batch = scheduler.TakeBatch(*worker); !batch.empty(); batch = scheduler.TakeBatch(*worker)) {
        done += int(batch.size());
        scheduler.Ended(batch);
      }
    });
  }
  constexpr int kTasks = 2000;
  for (int i = 0; i < kTasks; ++i) {
    while (!scheduler.Submit(MakeTask("a", Priority::kNormal, 0.001 * double(1 + i % 50))).ok()) {
      std::this_thread::yield();
    }
    if (i % 7 == 0) {  // one at a time too: no other task's end wakes its worker
      while (done < i + 1) std::this_thread::yield();
    }
  }
  scheduler.Drain();
  EXPECT_EQ(done, kTasks);
  scheduler.Stop();
  for (std::thread& worker : workers) worker.join();
}

}  // namespace
}  // namespace voxelpipe
