#include "base/threads.h"

#include <algorithm>
#include <atomic>
#include <vector>

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "base/machine.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

int ThreadsInside(int threads) {
  int inside = 0;
  RunOnThreads(threads, [&] { inside = tbb::this_task_arena::max_concurrency(); });
  return inside;
}

TEST(ThreadsTest, NoMoreThanCpus) {
  EXPECT_EQ(ThreadsInside(1), 1);
  EXPECT_EQ(ThreadsInside(0), CpuCount());
  EXPECT_EQ(ThreadsInside(CpuCount() + 5), CpuCount());
}

TEST(ThreadsTest, EachOnceAndNoMoreAtTheSameTimeThanThreads) {
  for (const int threads : {1, 2}) {
    std::vector<std::atomic<int>> calls(1000);
    std::atomic<int> now{0}, most{0};
    RunEachOnThreads(threads, calls.size(), [&](size_t i) {
      const int others = ++now;
      for (int known = most; known < others && !most.compare_exchange_weak(known, others);) {}
      ++calls[i];
      --now;
    });
    EXPECT_TRUE(std::all_of(calls.begin(), calls.end(), [](const auto& n) { return n == 1; }));
    EXPECT_LE(most, threads);
  }
}

// While it waits for its own loop a body would else find the next one on its stack.
TEST(ThreadsTest, ABodyThatWaitsIsGivenNoOther) {
  static thread_local int depth = 0;
  std::atomic<int> deepest{0};
  RunEachOnThreads(0, 64, [&](size_t) {
    const int here = ++depth;
    for (int known = deepest; known < here && !deepest.compare_exchange_weak(known, here);) {}
    tbb::parallel_for(0, 64, [](int) {});
    --depth;
  });
  EXPECT_EQ(deepest, 1);
}

TEST(ThreadsTest, AllLoopsTogetherAreBoundedByTheCpus) {
  LimitThreadsToCpus();
  LimitThreadsToCpus();
  EXPECT_EQ(tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism), size_t(CpuCount()));
}

}  // namespace
}  // namespace voxelpipe
