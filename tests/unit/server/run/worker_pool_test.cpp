#include "run/worker_pool.h"

#include <atomic>
#include <functional>
#include <latch>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// Runs a function on a loader.
class Function final : public Task {
 public:
  explicit Function(std::function<void()> run) : run_(std::move(run)) {}
  bool loaded() const override { return false; }
  bool Load() override {
    run_();
    return false;
  }
  void Refuse(absl::Status) override {}

 private:
  const std::function<void()> run_;
};

// A scheduler and its loaders, no devices.
class Pool {
 public:
  Pool(int workers, size_t max_queue)
      : scheduler_({.max_queue = max_queue, .max_batch_jobs = 1, .loaders = size_t(workers)}, size_t(workers)),
        pool_(scheduler_, {workers, {}, 0}, {}) {}

  std::shared_ptr<Task> Submit(std::function<void()> run, absl::Status* refused = nullptr) {
    auto task = std::make_shared<Function>(std::move(run));
    const absl::Status s = scheduler_.Submit(task);
    if (refused != nullptr) *refused = s;
    return s.ok() ? task : nullptr;
  }
  Scheduler& scheduler() { return scheduler_; }
  void Resize(int loaders) { pool_.Resize(loaders, 1); }
  void Drain() { scheduler_.Drain(); }

 private:
  Scheduler scheduler_;
  WorkerPool pool_;
};

// Holds the pool's only worker until told to go on.
class Blocker {
 public:
  explicit Blocker(Pool& pool) {
    EXPECT_TRUE(pool.Submit([this] {
      started_.count_down();
      go_.wait();
    }));
    started_.wait();
  }
  void Release() { go_.count_down(); }

 private:
  std::latch started_{1}, go_{1};
};

TEST(WorkerPoolTest, RunsJobsInTheOrderTheyCame) {
  std::vector<int> order;
  {
    Pool pool(1, 100);
    for (int i = 0; i < 20; ++i) ASSERT_TRUE(pool.Submit([&order, i] { order.push_back(i); }));
    pool.Drain();
  }
  ASSERT_EQ(order.size(), 20u);
  for (int i = 0; i < 20; ++i) EXPECT_EQ(order[size_t(i)], i);
}

TEST(WorkerPoolTest, MoreLoadersComeAndSomeGo) {
  Pool pool(1, 100);
  pool.Resize(2);
  {
    std::latch both(2);  // opens only where two are loaded at the same time
    for (int i = 0; i < 2; ++i) ASSERT_TRUE(pool.Submit([&both] { both.arrive_and_wait(); }));
    pool.Drain();
  }
}

TEST(WorkerPoolTest, FewerLoadersThanThreads) {
  Pool pool(3, 100);
  pool.Resize(1);
  std::atomic<int> now{0}, most{0};
  for (int i = 0; i < 30; ++i) {
    ASSERT_TRUE(pool.Submit([&] {
      const int others = ++now;
      for (int known = most; known < others && !most.compare_exchange_weak(known, others);) {}
      std::this_thread::yield();
      --now;
    }));
  }
  pool.Drain();
  EXPECT_EQ(most, 1);
}

TEST(WorkerPoolTest, AFullQueueIsAResourceThatComesBack) {
  Pool pool(1, 2);
  Blocker blocker(pool);
  std::atomic<int> ran = 0;
  EXPECT_TRUE(pool.Submit([&] { ++ran; }));
  EXPECT_TRUE(pool.Submit([&] { ++ran; }));
  absl::Status refused;
  pool.Submit([&] { ++ran; }, &refused);
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_TRUE(RetryDelay(refused).has_value()) << refused;
  EXPECT_EQ(pool.scheduler().queued(), 2u);
  blocker.Release();
  pool.Drain();
  EXPECT_EQ(ran, 2);
}

TEST(WorkerPoolTest, WithoutAQueueAnIdleWorkerStillTakesAJob) {
  Pool pool(1, 0);
  std::latch done(1);
  EXPECT_TRUE(pool.Submit([&] { done.count_down(); }));
  done.wait();
}

TEST(WorkerPoolTest, AWithdrawnJobNeverRunsAndMakesRoom) {
  Pool pool(1, 1);
  Blocker blocker(pool);
  bool ran = false;
  auto owned = std::make_shared<int>(1);
  std::shared_ptr<Task> task = pool.Submit([&ran, owned] { ran = true; });
  ASSERT_TRUE(task);
  EXPECT_EQ(owned.use_count(), 2);
  EXPECT_TRUE(pool.scheduler().Withdraw(*task));
  EXPECT_FALSE(pool.scheduler().Withdraw(*task));
  task.reset();
  EXPECT_EQ(owned.use_count(), 1) << "the scheduler keeps nothing of a withdrawn task";
  EXPECT_TRUE(pool.Submit([] {}));
  blocker.Release();
  pool.Drain();
  EXPECT_FALSE(ran);
}

TEST(WorkerPoolTest, ARunningJobCannotBeWithdrawn) {
  Pool pool(1, 1);
  std::latch started(1), go(1);
  const std::shared_ptr<Task> task = pool.Submit([&] {
    started.count_down();
    go.wait();
  });
  ASSERT_TRUE(task);
  started.wait();
  EXPECT_FALSE(pool.scheduler().Withdraw(*task));
  EXPECT_EQ(pool.scheduler().running(), 1u);
  go.count_down();
}

TEST(WorkerPoolTest, DrainEndsWhatWasAcceptedAndRefusesMore) {
  Pool pool(2, 100);
  std::atomic<int> ran = 0;
  for (int i = 0; i < 50; ++i) {
    ASSERT_TRUE(pool.Submit([&] {
      std::this_thread::yield();
      ++ran;
    }));
  }
  pool.Drain();
  EXPECT_EQ(ran, 50);
  absl::Status refused;
  pool.Submit([] {}, &refused);
  EXPECT_EQ(refused.code(), absl::StatusCode::kUnavailable);
}

TEST(ThreadsForTest, AreWorthTheirWorkAndShareTheCores) {
  EXPECT_EQ(ThreadsFor(0.1, 0, 1, 8), 1);
  EXPECT_EQ(ThreadsFor(3.5, 0, 1, 8), 3);
  EXPECT_EQ(ThreadsFor(50, 0, 1, 8), 8);
  EXPECT_EQ(ThreadsFor(50, 3, 1, 8), 3);
  EXPECT_EQ(ThreadsFor(50, 0, 3, 8), 2);
  EXPECT_EQ(ThreadsFor(50, 0, 9, 8), 1);
  EXPECT_EQ(ThreadsFor(5000, 0, 9, 8), 8) << "a long job outlasts the others";
  EXPECT_EQ(ThreadsFor(5000, 3, 9, 8), 3);
}

TEST(WorkerPoolTest, RunsAsManyJobsAtOnceAsItHasWorkers) {
  Pool pool(3, 0);
  std::latch together(3);  // returns only if all three run at the same time
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(pool.Submit([&] { together.arrive_and_wait(); }));
  pool.Drain();
}

}  // namespace
}  // namespace voxelpipe
