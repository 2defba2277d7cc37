// When the requests of an open loop are due.
#include "bench/arrivals.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace voxelpipe::cli {
namespace {

using std::chrono::nanoseconds;

std::vector<double> Gaps(Arrivals arrivals, double per_second, int count, uint64_t seed = 1) {
  ArrivalSchedule schedule(per_second, arrivals, seed);
  std::vector<double> gaps;
  for (nanoseconds last{0}; int(gaps.size()) < count;) {
    const nanoseconds next = schedule.Next();
    EXPECT_GE(next, last);
    gaps.push_back(double((next - last).count()) * 1e-9);
    last = next;
  }
  return gaps;
}

TEST(ArrivalSchedule, FixedGapsDoNotDrift) {
  ArrivalSchedule schedule(3, Arrivals::kFixed, 1);
  EXPECT_EQ(schedule.Next(), nanoseconds(0));
  EXPECT_EQ(schedule.Next(), nanoseconds(333333333));
  nanoseconds last{0};
  for (int i = 2; i <= 3'000'000; ++i) last = schedule.Next();
  EXPECT_EQ(last, std::chrono::seconds(1'000'000));
}

TEST(ArrivalSchedule, PoissonGapsAreExponential) {
  constexpr int kCount = 100000;
  const std::vector<double> gaps = Gaps(Arrivals::kPoisson, 1000, kCount);
  double sum = 0, squares = 0;
  int long_ones = 0;
  for (const double gap : gaps) {
    sum += gap;
    squares += gap * gap;
    if (gap > 2e-3) ++long_ones;
  }
  const double mean = sum / kCount;
  EXPECT_NEAR(mean, 1e-3, 2e-5);
  EXPECT_NEAR(squares / kCount - mean * mean, 1e-6, 5e-8);        // variance = mean^2
  EXPECT_NEAR(double(long_ones) / kCount, std::exp(-2.0), 5e-3);  // P(gap > 2 means)
}

TEST(ArrivalSchedule, TheSeedDecides) {
  EXPECT_EQ(Gaps(Arrivals::kPoisson, 50, 100, 3), Gaps(Arrivals::kPoisson, 50, 100, 3));
  EXPECT_NE(Gaps(Arrivals::kPoisson, 50, 100, 3), Gaps(Arrivals::kPoisson, 50, 100, 4));
}

}  // namespace
}  // namespace voxelpipe::cli
