// Percentiles of a load's latencies.
#include "bench/histogram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace voxelpipe::cli {
namespace {

TEST(Histogram, WithoutValuesEverythingIsZero) {
  const Histogram histogram;
  EXPECT_EQ(histogram.count(), 0u);
  EXPECT_EQ(histogram.max(), 0u);
  EXPECT_EQ(histogram.Mean(), 0);
  EXPECT_EQ(histogram.Percentile(0.5), 0u);
}

TEST(Histogram, SmallValuesAreExact) {
  Histogram histogram;
  for (uint64_t value = 1; value <= 100; ++value) histogram.Add(value);
  EXPECT_EQ(histogram.Percentile(0), 1u);
  EXPECT_EQ(histogram.Percentile(0.01), 1u);
  EXPECT_EQ(histogram.Percentile(0.5), 50u);
  EXPECT_EQ(histogram.Percentile(0.501), 51u);
  EXPECT_EQ(histogram.Percentile(0.99), 99u);
  EXPECT_EQ(histogram.Percentile(1), 100u);
  EXPECT_EQ(histogram.Mean(), 50.5);
}

TEST(Histogram, PercentilesAreNeverTooSmallAndAtMostOnePart256TooLarge) {
  std::mt19937_64 random(7);
  std::vector<uint64_t> values;
  Histogram histogram;
  for (int i = 0; i < 20000; ++i) {
    values.push_back(random() >> (random() % 64));  // every magnitude
    histogram.Add(values.back());
  }
  std::sort(values.begin(), values.end());
  for (const double p : {0.001, 0.1, 0.5, 0.9, 0.99, 0.999, 1.0}) {
    const uint64_t exact = values[size_t(std::ceil(p * 20000)) - 1];
    EXPECT_GE(histogram.Percentile(p), exact) << p;
    EXPECT_LE(histogram.Percentile(p) - exact, exact / 256) << p;
  }
}

TEST(Histogram, TakesTheLargestValues) {
  Histogram histogram;
  constexpr uint64_t kLargest = std::numeric_limits<uint64_t>::max();
  for (const uint64_t value : {uint64_t{511}, uint64_t{512}, uint64_t{513}, kLargest}) histogram.Add(value);
  EXPECT_EQ(histogram.max(), kLargest);
  EXPECT_EQ(histogram.Percentile(1), kLargest);
  EXPECT_EQ(histogram.Percentile(0.25), 511u);
}

TEST(Histogram, MergedIsTheSameAsCountedTogether) {
  Histogram together, a, b;
  for (uint64_t i = 0; i < 1000; ++i) {
    together.Add(i * i);
    (i % 3 == 0 ? a : b).Add(i * i);
  }
  a.Merge(b);
  EXPECT_EQ(a.count(), together.count());
  EXPECT_EQ(a.max(), together.max());
  EXPECT_DOUBLE_EQ(a.Mean(), together.Mean());
  for (const double p : {0.1, 0.5, 0.99}) EXPECT_EQ(a.Percentile(p), together.Percentile(p));
}

}  // namespace
}  // namespace voxelpipe::cli
