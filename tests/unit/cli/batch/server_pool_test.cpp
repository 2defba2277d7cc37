// Which server gets the next item.
#include "batch/server_pool.h"

#include <gtest/gtest.h>

#include <vector>

namespace voxelpipe::cli {
namespace {

using std::chrono::milliseconds;

class ServerPoolTest : public ::testing::Test {
 protected:
  ServerPool::TimePoint now_{milliseconds(1'000'000)};
};

TEST_F(ServerPoolTest, SpreadsItemsEvenly) {
  ServerPool pool(3);
  std::vector<int> given(3);
  for (int i = 0; i < 9; ++i) ++given[*pool.Take(now_)];
  EXPECT_EQ(given, (std::vector<int>{3, 3, 3}));
  pool.Return(1);
  EXPECT_EQ(pool.Take(now_), 1u);  // the one with the fewest
}

TEST_F(ServerPoolTest, ALostServerRestsLongerEachTime) {
  ServerPool pool(1);
  milliseconds last{0};
  for (int i = 0; i < 12; ++i) {
    ASSERT_TRUE(pool.Take(now_).has_value());
    pool.Lost(0, now_);
    pool.Return(0);
    EXPECT_FALSE(pool.Take(now_).has_value());
    const milliseconds rest = std::chrono::duration_cast<milliseconds>(pool.NextFree() - now_);
    EXPECT_EQ(rest, i == 0 ? milliseconds(250) : std::min(last * 2, milliseconds(30000)));
    last = rest;
    now_ = pool.NextFree();
  }
  ASSERT_TRUE(pool.Take(now_).has_value());
  pool.Answered(0);  // it is back
  pool.Return(0);
  pool.Lost(0, now_);
  EXPECT_EQ(pool.NextFree() - now_, milliseconds(250));
}

TEST_F(ServerPoolTest, ItemsThatWereUnderWayTogetherAreOneLoss) {
  ServerPool pool(1);
  for (int i = 0; i < 4; ++i) pool.Take(now_);
  for (int i = 0; i < 4; ++i) pool.Lost(0, now_ + milliseconds(i));
  EXPECT_EQ(pool.NextFree(), now_ + milliseconds(250));
}

TEST_F(ServerPoolTest, OthersTakeOverWhileOneRests) {
  ServerPool pool(2);
  pool.Lost(0, now_);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(pool.Take(now_), 1u);
  EXPECT_LE(pool.NextFree(), now_);
  now_ += milliseconds(250);
  EXPECT_EQ(pool.Take(now_), 0u);
}

TEST_F(ServerPoolTest, ABusyServerIsAskedAgainWhenItSaid) {
  ServerPool pool(1);
  pool.Busy(0, now_, milliseconds(700));
  EXPECT_FALSE(pool.Take(now_ + milliseconds(699)).has_value());
  EXPECT_EQ(pool.NextFree(), now_ + milliseconds(700));
  EXPECT_TRUE(pool.Take(now_ + milliseconds(700)).has_value());
  pool.Busy(0, now_, milliseconds(0));  // never a spin
  EXPECT_GT(pool.NextFree(), now_);
}

TEST_F(ServerPoolTest, AllAreGoneOnceNoneCanBeReached) {
  ServerPool pool(2);
  pool.Unreachable(0, now_);
  EXPECT_FALSE(pool.GoneSince().has_value());
  pool.Unreachable(1, now_ + milliseconds(5));
  EXPECT_EQ(pool.GoneSince(), now_ + milliseconds(5));
  pool.Unreachable(0, now_ + milliseconds(900));
  EXPECT_EQ(pool.GoneSince(), now_ + milliseconds(5));  // still since then
  pool.Lost(0, now_ + milliseconds(1000));              // it was there
  EXPECT_FALSE(pool.GoneSince().has_value());
  pool.Unreachable(0, now_ + milliseconds(2000));
  EXPECT_EQ(pool.GoneSince(), now_ + milliseconds(2000));
  pool.Busy(1, now_, milliseconds(1));
  EXPECT_FALSE(pool.GoneSince().has_value());
}

}  // namespace
}  // namespace voxelpipe::cli
