// A scheduler for tests: the test is its only worker and drives its clock.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "schedule/scheduler.h"
#include "waiting_task.h"

namespace voxelpipe::testing {

using Tasks = std::vector<std::shared_ptr<Task>>;

inline const WorkerTraits kCpu{"cpu", BackendChoice::kCpu};
inline const WorkerTraits kGpu{"cuda:0", BackendChoice::kCuda};
inline const WorkerTraits kGpu1{"cuda:1", BackendChoice::kCuda};

// A scheduler whose time and timers the test drives.
class SchedulerTest : public ::testing::Test {
 protected:
  SchedulerTest() {
    options.now = [this] { return now; };
    options.timer_thread = false;
    options.max_batch_jobs = 64;
    options.max_batch_ms = 1e9;
  }
  ~SchedulerTest() override { Finish(); }

  Scheduler& Start(size_t workers = 2) {
    scheduler = std::make_unique<Scheduler>(options, workers);
    scheduler->SetDevice(kCpu, workers);
    return *scheduler;
  }
  // Runs all remaining tasks.
  void Finish() {
    if (!scheduler) return;
    for (const Tasks& batch : taken) scheduler->Ended(batch);
    taken.clear();
    for (Tasks batch = scheduler->TryTakeBatch(kCpu); !batch.empty(); batch = scheduler->TryTakeBatch(kCpu)) {
      scheduler->Ended(batch);
    }
  }
  Tasks Take(const WorkerTraits& worker = kCpu) {
    taken.push_back(scheduler->TryTakeBatch(worker));
    return taken.back();
  }
  // The next task, which ends immediately.
  std::shared_ptr<Task> RunOne() {
    const Tasks batch = scheduler->TryTakeBatch(kCpu);
    EXPECT_LE(batch.size(), 1u) << "set max_batch_jobs";
    if (batch.empty()) return nullptr;
    scheduler->Ended(batch);
    return batch[0];
  }
  void Pass(std::chrono::milliseconds time) {
    now += time;
    scheduler->RunTimers();
  }
  std::shared_ptr<WaitingTask> Submit(const std::string& client = "a", Priority priority = Priority::kNormal,
                                      double run_ms = 1) {
    return Submit(MakeTask(client, priority, run_ms));
  }
  std::shared_ptr<WaitingTask> Submit(std::shared_ptr<WaitingTask> task) {
    const absl::Status s = scheduler->Submit(task);
    EXPECT_TRUE(s.ok()) << s;
    return task;
  }

  SchedulerOptions options;
  JobContext::Clock::time_point now = JobContext::Clock::time_point() + std::chrono::hours(1);
  std::unique_ptr<Scheduler> scheduler;
  std::vector<Tasks> taken;
};

}  // namespace voxelpipe::testing
