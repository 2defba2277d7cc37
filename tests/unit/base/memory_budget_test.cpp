#include "base/memory_budget.h"

#include <gtest/gtest.h>

#include <limits>
#include <thread>
#include <vector>

#include "base/limit_error.h"

namespace voxelpipe {
namespace {

TEST(MemoryBudgetTest, RefusesWhatIsBeyondTheLimitAndSaysNeedAndLimit) {
  MemoryBudget budget(100);
  ASSERT_TRUE(budget.Take(60, "nodes").ok());
  const absl::Status full = budget.Take(41, "accessor 3");
  EXPECT_EQ(full.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_NE(full.message().find("accessor 3"), std::string::npos) << full;
  ASSERT_TRUE(LimitErrorOf(full).has_value());
  EXPECT_EQ(LimitErrorOf(full)->need_bytes, 101u);
  EXPECT_EQ(LimitErrorOf(full)->limit_bytes, 100u);
  EXPECT_TRUE(budget.Take(40, "nodes").ok());
  budget.Give(100);
  EXPECT_EQ(budget.used_bytes(), 0u);
  EXPECT_EQ(budget.peak_bytes(), 100u);
}

TEST(MemoryBudgetTest, ARefusalOfTheParentLeavesTheChildAsItWas) {
  MemoryBudget all(100);
  MemoryBudget one(80, &all), two(80, &all);
  ASSERT_TRUE(one.Take(70, "first").ok());
  EXPECT_FALSE(two.Take(40, "second").ok());
  EXPECT_EQ(two.used_bytes(), 0u);
  EXPECT_EQ(all.used_bytes(), 70u);
  one.Give(70);
  EXPECT_EQ(all.used_bytes(), 0u);
}

TEST(MemoryBudgetTest, AProductBeyond64BitsIsRefusedAndNotWrapped) {
  MemoryBudget budget(std::numeric_limits<uint64_t>::max() - 1);
  MemoryCharge charge(&budget);
  EXPECT_FALSE(charge.Grow(uint64_t{1} << 40, uint64_t{1} << 40, "instances").ok());
  EXPECT_EQ(charge.bytes(), 0u);
}

TEST(MemoryBudgetTest, AChargeGivesBackWhatItTook) {
  MemoryBudget budget(100);
  {
    MemoryCharge first(&budget);
    ASSERT_TRUE(first.Grow(30, "a").ok());
    MemoryCharge second = std::move(first);
    ASSERT_TRUE(second.Grow(5, 4, "b").ok());
    EXPECT_EQ(budget.used_bytes(), 50u);
    second.ShrinkTo(10);
    EXPECT_EQ(budget.used_bytes(), 10u);
  }
  EXPECT_EQ(budget.used_bytes(), 0u);
}

TEST(MemoryBudgetTest, ManyThreadsNeverTakeMoreThanTheLimit) {
  MemoryBudget budget(1000);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int i = 0; i < 5000; ++i) {
        if (budget.Take(400, "x").ok()) budget.Give(400);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(budget.used_bytes(), 0u);
  EXPECT_LE(budget.peak_bytes(), 800u);
}

}  // namespace
}  // namespace voxelpipe
