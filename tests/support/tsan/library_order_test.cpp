// That ThreadSanitizer knows the libraries' order between threads (a report fails the process), and that it still finds
// races where there is none.
#include <grpcpp/alarm.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <future>
#include <numeric>
#include <thread>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kReported = 66;  // how a process ends that ThreadSanitizer has found a race in

// Waits, without ordering anything, until `count` threads are here, so that no two of them take turns; not for ever,
// since there may be fewer.
void Meet(std::atomic<int>& here, int count) {
  here.fetch_add(1, std::memory_order_relaxed);
  const auto deadline = Clock::now() + std::chrono::seconds(10);
  while (here.load(std::memory_order_relaxed) < count && Clock::now() < deadline) std::this_thread::yield();
}

TEST(LibraryOrderTest, TasksSeeWhatWasBeforeThemAndWhoWaitsSeesWhatTheyDid) {
  constexpr int kRounds = 200, kTasks = 64;
  tbb::task_arena arena(2);
  std::vector<int> values(kTasks);
  for (int round = 0; round < kRounds; ++round) {
    std::iota(values.begin(), values.end(), round);
    arena.execute([&] {
      tbb::parallel_for(tbb::blocked_range<size_t>(0, kTasks, 1), [&](const tbb::blocked_range<size_t>& range) {
        for (size_t i = range.begin(); i < range.end(); ++i) values[i] *= 2;
      });
    });
    for (int i = 0; i < kTasks; ++i) ASSERT_EQ(values[size_t(i)], 2 * (round + i));
  }
}

TEST(LibraryOrderTest, ACallbackOfGrpcSeesWhatWasBeforeIt) {
  for (int round = 0; round < 100; ++round) {
    int value = round;
    std::promise<int> seen;
    grpc::Alarm alarm;
    alarm.Set(std::chrono::system_clock::now(), [&](bool) { seen.set_value(++value); });
    EXPECT_EQ(seen.get_future().get(), round + 1);
    EXPECT_EQ(value, round + 1);
  }
}

void RaceOfTasks() {
  int value = 0;
  std::atomic<int> here{0};
  tbb::task_arena arena(2);
  arena.execute([&] {
    tbb::parallel_for(0, 2, [&](int) {
      Meet(here, 2);
      ++value;
    });
  });
  std::exit(0);
}

void RaceWithACallback() {
  int value = 0;
  std::atomic<int> here{0};
  std::promise<void> done;
  grpc::Alarm alarm;
  alarm.Set(std::chrono::system_clock::now(), [&](bool) {
    Meet(here, 2);
    ++value;
    done.set_value();
  });
  Meet(here, 2);
  ++value;
  done.get_future().wait();
  std::exit(0);
}

TEST(LibraryOrderDeathTest, RacesOfTasksAndCallbacksAreStillReported) {
  testing::GTEST_FLAG(death_test_style) = "threadsafe";
  EXPECT_EXIT(RaceOfTasks(), testing::ExitedWithCode(kReported), "data race.*");
  EXPECT_EXIT(RaceWithACallback(), testing::ExitedWithCode(kReported), "data race.*");
}

}  // namespace
}  // namespace voxelpipe
