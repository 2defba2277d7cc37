#include "cpu/base/index_set.h"

#include <random>
#include <set>

#include "gtest/gtest.h"

namespace voxelpipe::cpu {
namespace {

// Bounds below, at and above a node and a level.
class IndexSetTest : public ::testing::TestWithParam<int64_t> {};

TEST_P(IndexSetTest, GivesItsNumbersBackByAscendingOrderFromAnyOne) {
  const int64_t bound = GetParam();
  IndexSet set(bound);
  std::set<int64_t> expected;
  std::mt19937_64 random(uint64_t(bound) + 7);
  const auto draw = [&] { return int64_t(random() % uint64_t(bound)); };
  EXPECT_TRUE(set.empty());
  for (int step = 0; step < 20'000; ++step) {
    // Now it grows, now it shrinks to nothing.
    if (random() % 8 < (step / 500 % 2 == 0 ? 5u : 3u)) {
      const int64_t number = draw();
      set.Insert(number);
      expected.insert(number);
    } else if (!expected.empty()) {
      const int64_t from = draw();
      auto least = expected.lower_bound(from);
      if (least == expected.end()) least = expected.begin();
      ASSERT_EQ(set.Take(from), *least) << "from " << from;
      expected.erase(least);
    }
    ASSERT_EQ(set.empty(), expected.empty());
  }
  set.Insert(bound - 1);
  set.Clear();
  EXPECT_TRUE(set.empty());
  set.Insert(0);
  EXPECT_EQ(set.Take(bound - 1), 0);
}

INSTANTIATE_TEST_SUITE_P(Bounds, IndexSetTest, ::testing::Values(1, 2, 63, 64, 65, 4095, 4096, 4097, 300'000));

}  // namespace
}  // namespace voxelpipe::cpu
