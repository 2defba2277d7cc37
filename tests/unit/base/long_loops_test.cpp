#include "base/long_loops.h"

#include <algorithm>
#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

// Inputs of one length that sorts find hard.
std::vector<std::vector<uint64_t>> Inputs(size_t count) {
  std::vector<std::vector<uint64_t>> inputs(7, std::vector<uint64_t>(count));
  for (size_t i = 0; i < count; ++i) {
    inputs[0][i] = i * 0x9E3779B97F4A7C15u >> 20;  // any order
    inputs[1][i] = i;
    inputs[2][i] = count - i;
    inputs[3][i] = 7;
    inputs[4][i] = inputs[0][i] % 3;
    inputs[5][i] = std::min(i, count - i);
    inputs[6][i] = i + 1 == count ? 0 : i;  // sorted but for the last
  }
  return inputs;
}

TEST(ParallelSortTest, SortsAsTheStandardLibrary) {
  for (const size_t count : {0, 1, 2, 4095, 4096, 4097, 8193, 100'003}) {
    for (std::vector<uint64_t> values : Inputs(count)) {
      std::vector<uint64_t> expected = values;
      std::sort(expected.begin(), expected.end());
      ASSERT_TRUE(ParallelSort({}, values).ok());
      EXPECT_EQ(values, expected) << count;
      std::sort(expected.begin(), expected.end(), std::greater<>());
      ASSERT_TRUE(ParallelSort({}, values, std::greater<>()).ok());
      EXPECT_EQ(values, expected) << count;
    }
  }
}

// A quicksort with fixed pivots compares every pair of elements of some inputs.
TEST(ParallelSortTest, NoInputTakesManyComparisons) {
  constexpr size_t kCount = 200'000;
  for (std::vector<uint64_t> values : Inputs(kCount)) {
    std::atomic<uint64_t> compared{0};
    ASSERT_TRUE(ParallelSort({}, values, [&](uint64_t a, uint64_t b) {
                  compared.fetch_add(1, std::memory_order_relaxed);
                  return a < b;
                }).ok());
    EXPECT_LT(compared.load(), kCount * 100);
  }
}

TEST(ParallelSortTest, ASortEndsSoonAfterItsJob) {
  constexpr size_t kCount = 4'000'000;
  constexpr uint64_t kBefore = 100'000;
  for (std::vector<uint64_t>& values : Inputs(kCount)) {
    JobContext job;
    std::atomic<uint64_t> compared{0};
    const absl::Status status = ParallelSort(job, values, [&](uint64_t a, uint64_t b) {
      if (compared.fetch_add(1, std::memory_order_relaxed) == kBefore) job.Cancel();
      return a < b;
    });
    EXPECT_EQ(status.code(), absl::StatusCode::kCancelled);
    EXPECT_LT(compared.load(), kCount);  // one thread alone ends after one step more
  }
}

TEST(LongLoopsTest, StepsCoverAllInOrder) {
  for (const uint64_t count : {uint64_t{0}, uint64_t{1}, kElementsAStep, kElementsAStep + 1, 3 * kElementsAStep}) {
    uint64_t next = 0;
    ASSERT_TRUE(InSteps({}, count, [&](uint64_t begin, uint64_t end) {
                  EXPECT_EQ(begin, next);
                  EXPECT_LE(end - begin, kElementsAStep);
                  next = end;
                }).ok());
    EXPECT_EQ(next, count);
  }
}

TEST(LongLoopsTest, AfterTheJobNoStepBegins) {
  JobContext job;
  int steps = 0;
  const absl::Status status = InSteps(job, 10 * kElementsAStep, [&](uint64_t, uint64_t) {
    if (++steps == 2) job.Cancel();
  });
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(steps, 2);
}

TEST(LongLoopsTest, ResizeFillsAndEndsWithTheJob) {
  std::vector<int> values = {1, 2};
  ASSERT_TRUE(Resize({}, values, 2 * kElementsAStep + 1, 5).ok());
  ASSERT_EQ(values.size(), 2 * kElementsAStep + 1);
  EXPECT_EQ(values[1], 2);
  EXPECT_EQ(values[2], 5);
  EXPECT_EQ(values.back(), 5);
  JobContext job;
  job.Cancel();
  std::vector<int> none;
  EXPECT_EQ(Resize(job, none, 10).code(), absl::StatusCode::kCancelled);
  EXPECT_TRUE(none.empty());
}

}  // namespace
}  // namespace voxelpipe
