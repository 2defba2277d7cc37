#include "work/byte_budget.h"

#include <thread>

#include "gtest/gtest.h"

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

}  // namespace
}  // namespace voxelpipe
