#include "observe/idle_memory.h"

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;
using Clock = IdleMemory::Clock;
constexpr uint64_t kMuch = IdleMemory::kWorthwhileBytes;

// A process whose memory this test sets. A trim gives all that is free to the system; it stays free in the allocator's
// books.
class IdleMemoryTest : public ::testing::Test {
 protected:
  IdleMemoryTest() {
    memory_.Look(milliseconds(0));
    trims_ = 0;
  }

  uint64_t used_ = 100 * kMuch, free_ = 0, resident_free_ = 0;
  int trims_ = 0;
  Clock::time_point released_until_;
  IdleMemory memory_{HeldMemory{[this] { return used_ + resident_free_; }, [this] { return free_; },
                                [this] {
                                  ++trims_;
                                  resident_free_ = 0;
                                },
                                [this](Clock::time_point moment) { released_until_ = moment; }}};
};

TEST_F(IdleMemoryTest, WhatStandsStillIsLeftAlone) {
  for (int i = 0; i < 3; ++i) memory_.Look(milliseconds(1));
  EXPECT_EQ(trims_, 0);
}

TEST_F(IdleMemoryTest, ALittleIsNotWorthIt) {
  free_ = resident_free_ = kMuch - 1;
  memory_.Look(milliseconds(1));
  EXPECT_EQ(trims_, 0);
}

TEST_F(IdleMemoryTest, WhatCameAndWentBetweenTwoLooksIsGivenBackOnce) {
  free_ = resident_free_ = kMuch;
  memory_.Look(milliseconds(1));
  EXPECT_EQ(resident_free_, 0u);
  memory_.Look(milliseconds(1));
  EXPECT_EQ(trims_, 1);
  resident_free_ = kMuch;  // the same free places once more: nothing shows that but the process's size
  memory_.Look(milliseconds(1));
  EXPECT_EQ(trims_, 2);
}

TEST_F(IdleMemoryTest, WhatWasInUseAtATrimIsGivenBackWhenItIsFree) {
  used_ += kMuch;
  memory_.Look(milliseconds(1));  // the process has grown
  EXPECT_EQ(trims_, 1);
  used_ -= kMuch;
  free_ = resident_free_ = kMuch;  // now it has not
  memory_.Look(milliseconds(1));
  EXPECT_EQ(trims_, 2);
  EXPECT_EQ(resident_free_, 0u);
}

TEST_F(IdleMemoryTest, GrowthCountsFromTheLeastSeen) {
  used_ -= 2 * kMuch;
  memory_.Look(milliseconds(1));
  EXPECT_EQ(trims_, 0);
  used_ += kMuch;
  memory_.Look(milliseconds(1));
  EXPECT_EQ(trims_, 1);
}

TEST_F(IdleMemoryTest, PooledBlocksGoWhenTheyWereNotUsedForSoLong) {
  const Clock::time_point now = Clock::now();
  memory_.Look(milliseconds(250), now);
  EXPECT_EQ(released_until_, now - milliseconds(250));
}

TEST(KeptMemoryTest, FreedMemoryIsKeptInProportionToWhatThereIs) {
  constexpr uint64_t kMiB = 1 << 20;
  EXPECT_EQ(KeptBytesOfThread(1024 * kMiB, 4), 16 * kMiB);
  EXPECT_EQ(KeptBytesOfThread(uint64_t{1} << 40, 4), 64 * kMiB);
  EXPECT_EQ(KeptBytesOfThread(64 * kMiB, 64), kMiB);
  EXPECT_EQ(KeptBytesOfThread(1024 * kMiB, 0), 64 * kMiB);
}

}  // namespace
}  // namespace voxelpipe
