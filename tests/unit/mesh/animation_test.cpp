#include "mesh/scene/animation.h"

#include <cmath>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

AnimationSampler Sampler(Interpolation how, std::vector<float> times, std::vector<float> values, uint32_t width) {
  AnimationSampler s;
  s.interpolation = how;
  s.times = std::move(times);
  s.values = std::move(values);
  s.width = width;
  return s;
}

double At(const AnimationSampler& s, double time) {
  double v[4] = {};
  SampleAnimation(s, false, time, v);
  return v[0];
}

TEST(AnimationTest, StepHoldsTheKeyBefore) {
  const auto s = Sampler(Interpolation::kStep, {1, 2, 4}, {10, 20, 40}, 1);
  EXPECT_EQ(At(s, 0), 10);
  EXPECT_EQ(At(s, 1.9), 10);
  EXPECT_EQ(At(s, 2), 20);
  EXPECT_EQ(At(s, 9), 40);
}

TEST(AnimationTest, LinearInterpolatesAndClampsAtTheEnds) {
  const auto s = Sampler(Interpolation::kLinear, {1, 3}, {10, 20}, 1);
  EXPECT_EQ(At(s, -5), 10);
  EXPECT_EQ(At(s, 1.5), 12.5);
  EXPECT_EQ(At(s, 3), 20);
  EXPECT_EQ(At(s, 99), 20);
}

TEST(AnimationTest, CubicSplineIsHermiteWithTangentsScaledByTheInterval) {
  // (in, value, out) a key: 0 at t=0 with out-tangent 1, 2 at t=2 with in-tangent 3.
  const auto s = Sampler(Interpolation::kCubicSpline, {0, 2}, {7, 0, 1, 3, 2, 7}, 1);
  EXPECT_EQ(At(s, 0), 0);
  EXPECT_EQ(At(s, 2), 2);
  // u = 1/2: 0 + 2 * (1/8) * 1 + (1/2) * 2 + 2 * (-1/8) * 3
  EXPECT_DOUBLE_EQ(At(s, 1), 0.25 + 1 - 0.75);
}

TEST(AnimationTest, RotationsGoTheShorterWayAtEvenSpeed) {
  const float r = std::sqrt(0.5f);
  // 0 to 90 degrees about z, the second key with its sign turned.
  const auto s = Sampler(Interpolation::kLinear, {0, 1}, {0, 0, 0, 1, 0, 0, -r, -r}, 4);
  double q[4];
  SampleAnimation(s, true, 1.0 / 3, q);
  const double pi = std::acos(-1.0);
  EXPECT_NEAR(std::abs(q[2]), std::sin(pi / 12), 1e-7);  // 30 degrees
  EXPECT_NEAR(std::abs(q[3]), std::cos(pi / 12), 1e-7);
  EXPECT_GT(q[2] * q[3], 0);
}

}  // namespace
}  // namespace voxelpipe
