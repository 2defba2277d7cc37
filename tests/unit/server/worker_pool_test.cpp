#include "work/worker_pool.h"

#include <atomic>
#include <latch>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// Holds the pool's only worker until told to go on.
class Blocker {
 public:
  explicit Blocker(WorkerPool& pool) {
    EXPECT_TRUE(pool.Submit([this] {
                      started_.count_down();
                      go_.wait();
                    })
                    .ok());
    started_.wait();
  }
  void Release() { go_.count_down(); }

 private:
  std::latch started_{1}, go_{1};
};

TEST(WorkerPoolTest, RunsJobsInTheOrderTheyCame) {
  std::vector<int> order;
  {
    WorkerPool pool(1, 100);
    for (int i = 0; i < 20; ++i) ASSERT_TRUE(pool.Submit([&order, i] { order.push_back(i); }).ok());
    pool.Drain();
  }
  ASSERT_EQ(order.size(), 20u);
  for (int i = 0; i < 20; ++i) EXPECT_EQ(order[size_t(i)], i);
}

TEST(WorkerPoolTest, AFullQueueIsAResourceThatComesBack) {
  WorkerPool pool(1, 2);
  Blocker blocker(pool);
  std::atomic<int> ran = 0;
  EXPECT_TRUE(pool.Submit([&] { ++ran; }).ok());
  EXPECT_TRUE(pool.Submit([&] { ++ran; }).ok());
  const auto refused = pool.Submit([&] { ++ran; });
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_TRUE(RetryDelay(refused.status()).has_value()) << refused.status();
  EXPECT_EQ(pool.queued(), 2u);
  blocker.Release();
  pool.Drain();
  EXPECT_EQ(ran, 2);
}

TEST(WorkerPoolTest, WithoutAQueueAnIdleWorkerStillTakesAJob) {
  WorkerPool pool(1, 0);
  std::latch done(1);
  EXPECT_TRUE(pool.Submit([&] { done.count_down(); }).ok());
  done.wait();
}

TEST(WorkerPoolTest, AWithdrawnJobNeverRunsAndMakesRoom) {
  WorkerPool pool(1, 1);
  Blocker blocker(pool);
  bool ran = false;
  auto owned = std::make_shared<int>(1);
  const auto ticket = pool.Submit([&ran, owned] { ran = true; });
  ASSERT_TRUE(ticket.ok());
  EXPECT_EQ(owned.use_count(), 2);
  EXPECT_TRUE(pool.Withdraw(*ticket));
  EXPECT_EQ(owned.use_count(), 1) << "what a withdrawn job owns is freed at once";
  EXPECT_FALSE(pool.Withdraw(*ticket));
  EXPECT_TRUE(pool.Submit([] {}).ok());
  blocker.Release();
  pool.Drain();
  EXPECT_FALSE(ran);
}

TEST(WorkerPoolTest, ARunningJobCannotBeWithdrawn) {
  WorkerPool pool(1, 1);
  std::latch started(1), go(1);
  const auto ticket = pool.Submit([&] {
    started.count_down();
    go.wait();
  });
  ASSERT_TRUE(ticket.ok());
  started.wait();
  EXPECT_FALSE(pool.Withdraw(*ticket));
  EXPECT_EQ(pool.running(), 1u);
  go.count_down();
}

TEST(WorkerPoolTest, DrainEndsWhatWasAcceptedAndRefusesMore) {
  WorkerPool pool(2, 100);
  std::atomic<int> ran = 0;
  for (int i = 0; i < 50; ++i) {
    ASSERT_TRUE(pool.Submit([&] {
                      std::this_thread::yield();
                      ++ran;
                    })
                    .ok());
  }
  pool.Drain();
  EXPECT_EQ(ran, 50);
  EXPECT_EQ(pool.Submit([] {}).status().code(), absl::StatusCode::kUnavailable);
}

TEST(WorkerPoolTest, RunsAsManyJobsAtOnceAsItHasWorkers) {
  WorkerPool pool(3, 0);
  std::latch together(3);  // returns only if all three run at the same time
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(pool.Submit([&] { together.arrive_and_wait(); }).ok());
  pool.Drain();
}

}  // namespace
}  // namespace voxelpipe
