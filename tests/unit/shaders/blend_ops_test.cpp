#include "shaders/blend_ops.h"

#include <cmath>
#include <limits>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

constexpr double kQuantum = 0x1p-20;
const float kNan = std::numeric_limits<float>::quiet_NaN();

TEST(BlendOpsTest, NegativeZeroIsBelowPositiveZero) {
  EXPECT_TRUE(std::signbit(BlendMin(0.0f, -0.0f)));
  EXPECT_TRUE(std::signbit(BlendMin(-0.0f, 0.0f)));
  EXPECT_FALSE(std::signbit(BlendMax(-0.0f, 0.0f)));
  EXPECT_FALSE(std::signbit(BlendMax(0.0f, -0.0f)));
  EXPECT_EQ(BlendMin(-3.0f, 2.0f), -3.0f);
  EXPECT_EQ(BlendMax(-3.0f, 2.0f), 2.0f);
}

TEST(BlendOpsTest, NanBecomesZeroBeforeBlending) {
  FragmentOutput out;
  out.f[0] = kNan;
  EXPECT_EQ(ToF32(out, false, 0), 0.0f);
  EXPECT_FALSE(ToBit(out, false));
}

TEST(BlendOpsTest, UnsignedOutputsRoundToNearestEven) {
  FragmentOutput out;
  out.u[0] = (1u << 24) + 1;
  EXPECT_EQ(ToF32(out, true, 0), 16777216.0f);
  out.u[0] = (1u << 24) + 3;
  EXPECT_EQ(ToF32(out, true, 0), 16777220.0f);
  EXPECT_TRUE(ToBit(out, true));
}

TEST(BlendOpsTest, QuantizeRoundsToEvenAndClamps) {
  EXPECT_EQ(Quantize(1.0f, kQuantum), 1 << 20);
  EXPECT_EQ(Quantize(float(1.5 * kQuantum), kQuantum), 2);
  EXPECT_EQ(Quantize(float(2.5 * kQuantum), kQuantum), 2);
  EXPECT_EQ(Quantize(float(-2.5 * kQuantum), kQuantum), -2);
  EXPECT_EQ(Quantize(std::numeric_limits<float>::infinity(), kQuantum), int64_t{1} << 40);
  EXPECT_EQ(Quantize(-1e30f, kQuantum), -(int64_t{1} << 40));
}

TEST(BlendOpsTest, DequantizeConvertsOnce) {
  EXPECT_EQ(Dequantize(3 << 20, kQuantum), 3.0f);
  EXPECT_EQ(Dequantize((int64_t{1} << 50) + 1, kQuantum), float(0x1p30));
  EXPECT_EQ(Dequantize(-1, kQuantum), float(-kQuantum));
}

}  // namespace
}  // namespace voxelpipe
