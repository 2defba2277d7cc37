#include "state/idle_watch.h"

#include <memory>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;
using Clock = IdleWatch::Clock;

class IdleWatchTest : public ::testing::Test {
 protected:
  // With a clock that this test sets.
  IdleWatch watch_{milliseconds(0)};
  const Clock::time_point start_ = Clock::now();
  int idle_ = 0;
  std::unique_ptr<IdleWatch::Wait> wait_ =
      std::make_unique<IdleWatch::Wait>(watch_, milliseconds(100), [this] { ++idle_; });
};

TEST_F(IdleWatchTest, AWaitBeyondTheLimitIsToldOnce) {
  wait_->Begin(start_);
  watch_.Look(start_ + milliseconds(100));
  EXPECT_EQ(idle_, 0);
  watch_.Look(start_ + milliseconds(101));
  EXPECT_EQ(idle_, 1);
  watch_.Look(start_ + milliseconds(900));
  EXPECT_EQ(idle_, 1);
}

TEST_F(IdleWatchTest, AClientThatMovesStartsAnew) {
  wait_->Begin(start_);
  wait_->Begin(start_ + milliseconds(90));
  watch_.Look(start_ + milliseconds(180));
  EXPECT_EQ(idle_, 0);
  watch_.Look(start_ + milliseconds(191));
  EXPECT_EQ(idle_, 1);
}

TEST_F(IdleWatchTest, NobodyIsIdleWhoIsNotWaitedFor) {
  watch_.Look(start_ + milliseconds(500));
  wait_->Begin(start_);
  wait_->End();
  watch_.Look(start_ + milliseconds(500));
  wait_->Begin(start_);
  wait_.reset();
  watch_.Look(start_ + milliseconds(500));
  EXPECT_EQ(idle_, 0);
}

// As the call does whose last pointer the watch holds for a moment.
TEST_F(IdleWatchTest, TheWaitMayGoWhileItIsTold) {
  bool told = false;
  wait_ = std::make_unique<IdleWatch::Wait>(watch_, milliseconds(100), [&] {
    wait_.reset();
    told = true;
  });
  wait_->Begin(start_);
  watch_.Look(start_ + milliseconds(101));
  EXPECT_TRUE(told);
  EXPECT_EQ(wait_, nullptr);
}

// With the thread: every wait is found, or its end is waited for, and the thread ends with the watch.
TEST_F(IdleWatchTest, TheThreadFindsThem) {
  std::atomic<int> found{0};
  {
    IdleWatch live(milliseconds(1));
    IdleWatch::Wait wait(live, milliseconds(1), [&] { ++found; });
    wait.Begin();
    while (found == 0) std::this_thread::sleep_for(milliseconds(1));
  }
  EXPECT_EQ(found, 1);
}

}  // namespace
}  // namespace voxelpipe
