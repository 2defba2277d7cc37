#include "schedule/byte_budget.h"

#include <atomic>
#include <memory>
#include <thread>

#include "base/limit_error.h"
#include "gtest/gtest.h"
#include "jobs/request_memory.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;

TEST(ByteBudgetTest, GivesOutNoMoreThanItHas) {
  ByteBudget budget(100);
  EXPECT_TRUE(budget.TryTake(60));
  EXPECT_FALSE(budget.TryTake(41));
  EXPECT_TRUE(budget.TryTake(40));
  EXPECT_FALSE(budget.TryTake(1));
  EXPECT_FALSE(budget.TryTake(~uint64_t{0})) << "the sum must not wrap";
  budget.Give(100);
  EXPECT_EQ(budget.used(), 0u);
}

TEST(ByteBudgetTest, ALimitThatShrinksAndGrows) {
  ByteBudget budget(100);
  EXPECT_TRUE(budget.TryTake(60));
  budget.set_limit(50);
  EXPECT_FALSE(budget.TryTake(0)) << "more is taken than there is";
  EXPECT_FALSE(budget.TryTake(1));
  budget.Give(20);
  EXPECT_TRUE(budget.TryTake(10));
  EXPECT_FALSE(budget.TryTake(1));
  budget.set_limit(60);
  EXPECT_TRUE(budget.TryTake(10));
  EXPECT_EQ(budget.limit(), 60u);
  budget.Give(60);
}

TEST(ByteBudgetTest, ASharesBytesComeBackWhenItGoes) {
  ByteBudget budget(100);
  {
    BudgetShare share(budget);
    EXPECT_TRUE(share.TryGrow(30));
    EXPECT_TRUE(share.TryGrow(50));
    EXPECT_FALSE(share.TryGrow(21));
    EXPECT_EQ(budget.used(), 80u);
    share.ShrinkTo(10);
    EXPECT_EQ(budget.used(), 10u);
    share.ShrinkTo(90);  // no growth
    EXPECT_EQ(share.bytes(), 10u);
  }
  EXPECT_EQ(budget.used(), 0u);
}

TEST(ByteBudgetTest, AJobWaitsUntilAnotherGivesBack) {
  ByteBudget budget(100);
  BudgetShare first(budget), second(budget);
  ASSERT_TRUE(first.TryGrow(80));
  const JobContext job;
  std::thread giver([&] { first.ShrinkTo(0); });
  EXPECT_TRUE(second.Grow(50, job, milliseconds(60'000)));
  giver.join();
  EXPECT_EQ(budget.used(), 50u);
}

TEST(ByteBudgetTest, ACancelledJobAndAnImpatientOneGoWithout) {
  ByteBudget budget(100);
  BudgetShare first(budget), second(budget);
  ASSERT_TRUE(first.TryGrow(80));
  JobContext job;
  EXPECT_FALSE(second.Grow(50, job, milliseconds(1)));
  job.Cancel();
  EXPECT_FALSE(second.Grow(50, job, milliseconds(60'000)));
  EXPECT_EQ(budget.used(), 80u);
}

// Each waits for what the other holds: one must give up, at once.
TEST(ByteBudgetTest, RequestsThatHoldAllOfItDoNotWaitForEachOther) {
  ByteBudget budget(100);
  std::atomic<int> gave_up{0};
  const auto grow = [&](uint64_t holds) {
    const JobContext job;
    BudgetShare share(budget);
    ASSERT_TRUE(share.TryGrow(holds));
    while (budget.used() < 100 && gave_up == 0) std::this_thread::yield();
    if (!share.Grow(40, job, milliseconds(60'000))) ++gave_up;
  };
  const auto begin = std::chrono::steady_clock::now();
  std::thread first([&] { grow(50); }), second([&] { grow(50); });
  first.join();
  second.join();
  EXPECT_EQ(gave_up, 1);
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
  EXPECT_EQ(budget.used(), 0u);
}

TEST(RequestMemoryTest, BeyondTheLimitAloneIsTheLimitAndBesideOthersIsLoad) {
  ByteBudget working(1000);
  JobContext first_job, second_job;
  second_job.set_deadline(JobContext::Clock::now() + milliseconds(50));  // does not wait long
  const auto first = MakeRequestMemory(working, first_job), second = MakeRequestMemory(working, second_job);
  ASSERT_TRUE(first->Take(600, "a mesh").ok());
  const absl::Status alone = first->Take(401, "its rig");
  EXPECT_TRUE(LimitErrorOf(alone).has_value()) << alone;
  EXPECT_FALSE(IsInUseByOthers(alone));
  const absl::Status load = second->Take(500, "a mesh");
  EXPECT_TRUE(absl::IsResourceExhausted(load)) << load;
  EXPECT_TRUE(IsInUseByOthers(load));
  EXPECT_TRUE(second->Take(100, "a mesh").ok());
  EXPECT_TRUE(IsInUseByOthers(second->Take(100, "a mesh"))) << "the last quarter is for those that run";
  second->set_leave(0);
  EXPECT_TRUE(second->Take(100, "a mesh").ok());
  first->Give(600);
  second->Give(200);
  EXPECT_EQ(working.used(), 0u);
}

TEST(RequestMemoryTest, ALoadWaitsForOthers) {
  ByteBudget working(1000);
  JobContext first_job, second_job;
  const auto first = MakeRequestMemory(working, first_job), second = MakeRequestMemory(working, second_job);
  ASSERT_TRUE(first->Take(700, "a mesh").ok());
  std::thread giver([&] {
    std::this_thread::sleep_for(milliseconds(100));
    first->Give(700);
  });
  EXPECT_TRUE(second->Take(700, "a mesh").ok());
  giver.join();
  second->Give(700);
}

// A thread that takes, as threads do that load one file together.
class TakingThread {
 public:
  TakingThread(MemoryBudget& memory, uint64_t bytes)
      : thread_([&memory, bytes, this] { status_ = memory.Take(bytes, "a stream"); }) {}
  absl::Status End() {
    thread_.join();
    return status_;
  }

 private:
  absl::Status status_;
  std::thread thread_;
};

void WaitUntilUsed(const MemoryBudget& memory, uint64_t bytes) {
  while (memory.used_bytes() < bytes) std::this_thread::yield();
}

// While one thread waits another takes: what the first one is refused for and what it waits for must stay the same.
TEST(RequestMemoryTest, AThreadThatWaitsGetsItsMemoryThoughAnotherOfItsRequestTook) {
  ByteBudget working(256);
  JobContext other_job, job;
  const auto other = MakeRequestMemory(working, other_job), memory = MakeRequestMemory(working, job);
  ASSERT_TRUE(other->Take(150, "a mesh").ok());
  TakingThread waits(*memory, 160);
  WaitUntilUsed(*memory, 160);
  ASSERT_TRUE(TakingThread(*memory, 40).End().ok());
  EXPECT_EQ(memory->held_bytes(), 40u);
  other->Give(150);
  EXPECT_TRUE(waits.End().ok()) << "it is the only request: nothing is left to others";
  EXPECT_EQ(memory->held_bytes(), 200u);
  memory->Give(200);
  EXPECT_EQ(working.used(), 0u);
}

TEST(RequestMemoryTest, AThreadThatWaitsEndsByCancelThoughAnotherOfItsRequestTook) {
  ByteBudget working(256);
  JobContext other_job, job;
  const auto other = MakeRequestMemory(working, other_job), memory = MakeRequestMemory(working, job);
  ASSERT_TRUE(other->Take(100, "a mesh").ok());
  TakingThread waits(*memory, 160);
  WaitUntilUsed(*memory, 160);
  ASSERT_TRUE(TakingThread(*memory, 40).End().ok());
  other->Give(80);  // 20 are left, so that the quarter for others is not free
  job.Cancel();
  EXPECT_TRUE(IsInUseByOthers(waits.End()));
  EXPECT_FALSE(working.WaitFor(10, *memory, job, JobContext::Clock::now() + milliseconds(60'000)))
      << "who is told to try again does not see that the job has ended";
  other->Give(20);
  memory->Give(40);
  EXPECT_EQ(working.used(), 0u);
}

// What their request holds is held once, however many of its threads wait.
TEST(RequestMemoryTest, ThreadsOfOneRequestWaitForOthersAndNotForEachOther) {
  ByteBudget working(256);
  JobContext other_job, job;
  const auto other = MakeRequestMemory(working, other_job), memory = MakeRequestMemory(working, job);
  other->set_leave(0);
  memory->set_leave(0);
  ASSERT_TRUE(memory->Take(100, "a mesh").ok());
  ASSERT_TRUE(other->Take(100, "a mesh").ok());
  TakingThread first(*memory, 60), second(*memory, 60);
  WaitUntilUsed(*memory, 220);
  std::this_thread::sleep_for(milliseconds(50));  // they would give up now
  EXPECT_EQ(memory->used_bytes(), 220u);
  other->Give(100);
  EXPECT_TRUE(first.End().ok());
  EXPECT_TRUE(second.End().ok());
  memory->Give(220);
  EXPECT_EQ(working.used(), 0u);
}

TEST(RequestMemoryTest, ARequestsPatienceIsForAllOfItsWaits) {
  ByteBudget working(1000);
  JobContext other_job, job;
  const auto other = MakeRequestMemory(working, other_job);
  const auto memory = MakeRequestMemory(working, job, milliseconds(400));
  ASSERT_TRUE(other->Take(900, "a mesh").ok());
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 20; ++i) {
    TakingThread first(*memory, 300), second(*memory, 300);
    EXPECT_TRUE(IsInUseByOthers(first.End()));
    EXPECT_TRUE(IsInUseByOthers(second.End()));
  }
  const auto waited = std::chrono::steady_clock::now() - begin;
  EXPECT_GE(waited, milliseconds(400));
  EXPECT_LT(waited, milliseconds(4000)) << "each waits by itself";
  other->Give(900);
}

// The mesh of a job that was left behind on a device may outlive the server's budget.
TEST(RequestMemoryTest, ABudgetOutlivesWhatItTakesOf) {
  auto working = std::make_unique<ByteBudget>(1000);
  JobContext job;
  auto memory = MakeRequestMemory(*working, job);
  MemoryCharge charge(memory.get());
  ASSERT_TRUE(charge.Grow(100, "a mesh").ok());
  working.reset();
  charge.ShrinkTo(0);
  memory.reset();
}

}  // namespace
}  // namespace voxelpipe
