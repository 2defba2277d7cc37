#include "shaders/blend_ops.h"

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

constexpr double kQuantum = 0x1p-20;
const float kNan = std::numeric_limits<float>::quiet_NaN();
const double kInfinity = std::numeric_limits<double>::infinity();

FragmentOutput Floats(float x) {
  FragmentOutput out;
  out.f[0] = x;
  return out;
}

FragmentOutput Unsigned(uint32_t x) {
  FragmentOutput out;
  out.u[0] = x;
  return out;
}

// The value of binary16 bits by IEEE 754's own formula.
double HalfValue(uint16_t bits) {
  const int exponent = bits >> 10 & 31, mantissa = bits & 1023;
  double v = exponent == 0 ? std::ldexp(mantissa, -24) : std::ldexp(1024 + mantissa, exponent - 25);
  if (exponent == 31) v = mantissa == 0 ? kInfinity : double(kNan);
  return (bits & 0x8000) != 0 ? -v : v;
}

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

TEST(BlendOpsTest, EveryHalfHasItsValueAndComesBack) {
  for (uint32_t bits = 0; bits <= 0xffff; ++bits) {
    const auto half = uint16_t(bits);
    const float v = FromHalf(half);
    const double expected = HalfValue(half);
    if (expected != expected) {
      ASSERT_NE(v, v);
      ASSERT_EQ(HalfBits(double(v)), 0) << "NaN becomes 0";
      continue;
    }
    ASSERT_EQ(double(v), expected) << bits;
    ASSERT_EQ(std::signbit(v), (bits & 0x8000) != 0) << bits;
    ASSERT_EQ(HalfBits(expected), half);
  }
}

// Between two neighbours the halfway value goes to the even one, and the doubles next to it to their own side. The
// largest finite half's upper neighbour would be 65536: from halfway on it is infinity.
TEST(BlendOpsTest, HalvesRoundToNearestEvenAtEveryMidpoint) {
  for (uint16_t bits = 0; bits < 0x7c00; ++bits) {
    const double below = HalfValue(bits), above = bits == 0x7bff ? 65536.0 : HalfValue(uint16_t(bits + 1));
    const double middle = (below + above) / 2;  // exact
    const auto even = uint16_t(bits + (bits & 1));
    ASSERT_EQ(HalfBits(middle), even) << bits;
    ASSERT_EQ(HalfBits(-middle), even | 0x8000) << bits;
    ASSERT_EQ(HalfBits(std::nextafter(middle, 0.0)), bits) << bits;
    ASSERT_EQ(HalfBits(std::nextafter(middle, kInfinity)), bits + 1) << bits;
  }
  EXPECT_EQ(HalfBits(1e300), 0x7c00);
  EXPECT_EQ(HalfBits(-kInfinity), 0xfc00);
  EXPECT_EQ(HalfBits(-1e-300), 0x8000) << "the sign stays";
}

TEST(BlendOpsTest, IntegersRoundToNearestEvenAndSaturate) {
  for (const auto& [value, u8] : std::vector<std::pair<double, uint32_t>>{{-kInfinity, 0},
                                                                          {-1, 0},
                                                                          {-0.0, 0},
                                                                          {0.5, 0},
                                                                          {std::nextafter(0.5, 1.0), 1},
                                                                          {1.5, 2},
                                                                          {2.5, 2},
                                                                          {253.5, 254},
                                                                          {254.5, 254},
                                                                          {std::nextafter(254.5, 255.0), 255},
                                                                          {255, 255},
                                                                          {256, 255},
                                                                          {kInfinity, 255},
                                                                          {double(kNan), 0}}) {
    EXPECT_EQ(ToUnsigned(value, 0xff), u8) << value;
    EXPECT_EQ(NumberToCell(value, VoxelFormat::kU8), u8) << value;
  }
  EXPECT_EQ(ToUnsigned(65534.5, 0xffff), 65534u);
  EXPECT_EQ(ToUnsigned(4294967294.5, 0xffffffff), 4294967294u);
  EXPECT_EQ(ToUnsigned(4294967295.0, 0xffffffff), 4294967295u);
  EXPECT_EQ(ToUnsigned(1e30, 0xffffffff), 4294967295u);
}

TEST(BlendOpsTest, FloatOutputsAreScaledIntoIntegersOnly) {
  EXPECT_EQ(ToCell(Floats(0.5f), false, 0, VoxelFormat::kU8, 255), 128u);  // 127.5
  EXPECT_EQ(ToCell(Floats(1.0f), false, 0, VoxelFormat::kU16, 65535), 65535u);
  EXPECT_EQ(ToCell(Floats(2.0f), false, 0, VoxelFormat::kU8, 255), 255u);
  EXPECT_EQ(ToCell(Floats(-2.0f), false, 0, VoxelFormat::kU8, -3), 6u);
  EXPECT_EQ(ToCell(Floats(INFINITY), false, 0, VoxelFormat::kU32, 0), 0u) << "inf * 0 is NaN";
  EXPECT_EQ(ToCell(Floats(0.5f), false, 0, VoxelFormat::kF32, 255), BitsOf(0.5f));
  EXPECT_EQ(ToCell(Unsigned(70000), true, 0, VoxelFormat::kU8, 255), 255u);
  EXPECT_EQ(ToCell(Unsigned(200), true, 0, VoxelFormat::kU8, 255), 200u) << "u32 outputs are not scaled";
}

TEST(BlendOpsTest, UnsignedOutputsBecomeTheNearestHalf) {
  for (uint32_t u = 0; u < 70000; ++u) {
    const uint32_t cell = ToCell(Unsigned(u), true, 0, VoxelFormat::kF16, 1);
    ASSERT_EQ(StoredBits(cell, VoxelFormat::kF16), HalfBits(double(u)));
    if (u <= 2048) {
      ASSERT_EQ(FloatOf(cell), float(u));
    }
  }
  EXPECT_EQ(StoredBits(ToCell(Unsigned(UINT32_MAX), true, 0, VoxelFormat::kF16, 1), VoxelFormat::kF16), 0x7c00u);
}

TEST(BlendOpsTest, ClearAndFillValuesAreSaturatedAndRoundedNotScaled) {
  EXPECT_EQ(NumberToCell(0.25, VoxelFormat::kBit), 1u);
  EXPECT_EQ(NumberToCell(-0.0, VoxelFormat::kBit), 0u);
  EXPECT_EQ(NumberToCell(70000, VoxelFormat::kU16), 65535u);
  EXPECT_EQ(NumberToCell(-5, VoxelFormat::kU32), 0u);
  EXPECT_EQ(NumberToCell(2.5, VoxelFormat::kU32), 2u);
  EXPECT_EQ(NumberToCell(-0.0, VoxelFormat::kF32), 0x80000000u);
  EXPECT_EQ(NumberToCell(1e300, VoxelFormat::kF32), BitsOf(INFINITY));
  EXPECT_EQ(NumberToCell(16777217, VoxelFormat::kF32), BitsOf(16777216.0f));
  EXPECT_EQ(StoredBits(NumberToCell(0x1p-24 * 1.5, VoxelFormat::kF16), VoxelFormat::kF16), 2u);  // subnormal tie
  EXPECT_EQ(StoredBits(NumberToCell(65520, VoxelFormat::kF16), VoxelFormat::kF16), 0x7c00u);
  EXPECT_EQ(StoredBits(NumberToCell(65519, VoxelFormat::kF16), VoxelFormat::kF16), 0x7bffu);
}

TEST(BlendOpsTest, CellsBlendAsTheirBlendSays) {
  const uint32_t minus = BitsOf(-0.0f), plus = BitsOf(0.0f), low = BitsOf(-5.0f), high = BitsOf(3.0f);
  for (const auto& [a, b] : {std::pair{minus, plus}, {plus, minus}}) {
    EXPECT_EQ(BlendCell(Blend::kMin, true, a, b), minus);
    EXPECT_EQ(BlendCell(Blend::kMax, true, a, b), plus);
    EXPECT_EQ(BlendCell(Blend::kReplace, true, a, b), b);
    EXPECT_EQ(BlendCell(Blend::kFirst, true, a, b), a);
  }
  EXPECT_EQ(BlendCell(Blend::kMin, true, high, low), low);
  EXPECT_EQ(BlendCell(Blend::kMax, true, low, high), high);
  // As integers the bits of -5 are the larger.
  EXPECT_EQ(BlendCell(Blend::kMin, false, high, low), high);
  EXPECT_EQ(BlendCell(Blend::kMax, false, low, high), low);
  EXPECT_EQ(BlendCell(Blend::kOr, false, 0b0101, 0b0011), 0b0111u);
  EXPECT_EQ(BlendCell(Blend::kAnd, false, 0b0101, 0b0011), 0b0001u);
  for (const bool kept : {false, true}) {
    for (const bool v : {false, true}) {
      EXPECT_EQ(BlendBit(Blend::kOr, kept, v), kept || v);
      EXPECT_EQ(BlendBit(Blend::kAnd, kept, v), kept && v);
      EXPECT_EQ(BlendBit(Blend::kReplace, kept, v), v);
      EXPECT_EQ(BlendBit(Blend::kFirst, kept, v), kept);
    }
  }
}

TEST(BlendOpsTest, IntegerSumsAndCountsSaturateOnce) {
  const int64_t sum = int64_t{0xffffffff} * 1000;
  EXPECT_EQ(StoreSum(sum, VoxelFormat::kU32, kQuantum), 0xffffffffu);
  EXPECT_EQ(StoreSum(0xffffffff, VoxelFormat::kU32, kQuantum), 0xffffffffu);
  EXPECT_EQ(StoreSum(65536, VoxelFormat::kU16, kQuantum), 65535u);
  EXPECT_EQ(StoreSum(255, VoxelFormat::kU8, kQuantum), 255u);
  EXPECT_EQ(StoreCount(256, VoxelFormat::kU8), 255u);
  EXPECT_EQ(StoreCount(0xffffffff, VoxelFormat::kU32), 0xffffffffu);
  EXPECT_EQ(StoreCount(16777219, VoxelFormat::kF32), BitsOf(16777220.0f));
  EXPECT_EQ(StoreCount(2049, VoxelFormat::kF16), HalfBits(2048));
  EXPECT_EQ(StoreCount(65520, VoxelFormat::kF16), 0x7c00u);
}

TEST(BlendOpsTest, AveragesAreConvertedOnce) {
  EXPECT_EQ(StoreAverage(3, 2, VoxelFormat::kU8, kQuantum), 2u);  // 1.5
  EXPECT_EQ(StoreAverage(5, 2, VoxelFormat::kU8, kQuantum), 2u);  // 2.5
  EXPECT_EQ(StoreAverage(7, 3, VoxelFormat::kU16, kQuantum), 2u);
  EXPECT_EQ(StoreAverage(int64_t{0xffffffff} * 7, 7, VoxelFormat::kU32, kQuantum), 0xffffffffu)
      << "no early saturation";
  EXPECT_EQ(StoreAverage(1 << 20, 3, VoxelFormat::kF32, kQuantum), BitsOf(float(1.0 / 3.0)));
  EXPECT_EQ(StoreAverage(-(1 << 20), 3, VoxelFormat::kF16, kQuantum), HalfBits(-1.0 / 3.0));
}

// Against long double, which holds every sum exactly.
TEST(BlendOpsTest, SumsOfAnySizeAreRoundedOnce) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 200000; ++i) {
    const int64_t sum = int64_t(random()) >> (random() % 64);
    for (const double quantum : {0x1p-126, 0x1p-50, kQuantum, 1.0, 0x1p80}) {
      const long double exact = static_cast<long double>(sum) * quantum;
      ASSERT_EQ(Dequantize(sum, quantum), float(exact)) << sum << " " << quantum;
      // The half nearest to the exact sum: no half or midpoint of two lies between the sum and its double, except on
      // it.
      double near = double(exact);
      if (static_cast<long double>(near) != exact) near = std::nextafter(near, near < exact ? kInfinity : -kInfinity);
      const uint16_t low = HalfBits(double(exact)), high = HalfBits(near);
      const uint32_t stored = StoreSum(sum, VoxelFormat::kF16, quantum);
      ASSERT_TRUE(stored == low || stored == high);
      if (low != high) {  // the double is a midpoint exactly
        const bool up = std::abs(exact) > std::abs(static_cast<long double>(double(exact)));
        const uint16_t larger = (low & 0x7fff) > (high & 0x7fff) ? low : high, smaller = larger == low ? high : low;
        ASSERT_EQ(stored, up ? larger : smaller) << sum << " " << quantum;
      }
    }
  }
  // 2049 is halfway between the halves 2048 and 2050. As a double this sum is 2049; only the sum itself is above.
  const int64_t middle = (int64_t{2049} << 51) + 1;
  EXPECT_EQ(StoreSum(middle, VoxelFormat::kF16, 0x1p-51), HalfBits(2050));
  EXPECT_EQ(StoreSum(-middle, VoxelFormat::kF16, 0x1p-51), HalfBits(-2050));
  EXPECT_EQ(StoreSum(middle - 1, VoxelFormat::kF16, 0x1p-51), HalfBits(2048));
}

TEST(BlendOpsTest, QuantizeIsTheNearestMultiple) {
  std::mt19937_64 random(5);
  for (int i = 0; i < 200000; ++i) {
    const float v = FloatOf(uint32_t(random()));
    if (!(v == v)) continue;
    for (const double quantum : {0x1p-126, kQuantum, 1.0, 0x1p80}) {
      const double multiples = std::min(std::max(double(v) / quantum, -0x1p40), 0x1p40);
      ASSERT_EQ(Quantize(v, quantum), int64_t(std::nearbyint(multiples))) << v;
    }
  }
}

TEST(Snorm, MinusOneToOneFillsTheIntegers) {
  FragmentOutput out;
  const auto code = [&](float v, VoxelFormat format) {
    out.f[0] = v;
    return ToCell(out, false, 0, format, 1);
  };
  for (const auto& [v, u8, u16] : {std::tuple{-1.0f, 0u, 0u},
                                   {1.0f, 255u, 65535u},
                                   {0.0f, 128u, 32768u},  // 127.5 and 32767.5, to even
                                   {-0.5f, 64u, 16384u},  // 63.75, 16383.75
                                   {2.0f, 255u, 65535u},
                                   {-2.0f, 0u, 0u}}) {
    EXPECT_EQ(code(v, VoxelFormat::kU8Snorm), u8) << v;
    EXPECT_EQ(code(v, VoxelFormat::kU16Snorm), u16) << v;
  }
  EXPECT_EQ(code(std::nanf(""), VoxelFormat::kU8Snorm), 128u) << "as 0";
  const double quantum = 0x1p-20;
  const int64_t half = ToTerm(out, false, 0, VoxelFormat::kU8Snorm, 1, quantum) + (int64_t{1} << 19);
  EXPECT_EQ(StoreSum(half, VoxelFormat::kU8Snorm, quantum), 191u) << "191.25: of the sum, not the sum of codes";
  EXPECT_EQ(StoreAverage(-half, 2, VoxelFormat::kU8Snorm, quantum), 96u);  // of -0.25: 95.625
  EXPECT_EQ(NumberToCell(200.6, VoxelFormat::kU8Snorm), 201u) << "clear and fill are codes";
}

}  // namespace
}  // namespace voxelpipe
