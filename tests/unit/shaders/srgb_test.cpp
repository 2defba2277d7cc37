// The tables of srgb.h against exact arithmetic.
#include "shaders/texture/srgb.h"

#include <cmath>
#include <cstdint>
#include <vector>

#include "gtest/gtest.h"
#include "shaders/blend_ops.h"

namespace voxelpipe {
namespace {

// A number of any size, 32 bits a digit, the lowest first.
using Digits = std::vector<uint32_t>;

Digits Times(const Digits& a, const Digits& b) {
  Digits product(a.size() + b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    uint64_t carry = 0;
    for (size_t j = 0; j < b.size() || carry != 0; ++j) {
      const uint64_t sum = product[i + j] + carry + (j < b.size() ? uint64_t{a[i]} * b[j] : 0);
      product[i + j] = uint32_t(sum);
      carry = sum >> 32;
    }
  }
  return product;
}
Digits Power(uint64_t base, int exponent) {
  const Digits b{uint32_t(base), uint32_t(base >> 32)};
  Digits power{1};
  for (int i = 0; i < exponent; ++i) power = Times(power, b);
  return power;
}
bool AtLeast(Digits a, Digits b) {
  const size_t n = std::max(a.size(), b.size());
  a.resize(n);
  b.resize(n);
  for (size_t i = n; i-- > 0;) {
    if (a[i] != b[i]) return a[i] > b[i];
  }
  return true;
}

// True if the transfer function (IEC 61966-2-1) brings v, not negative, to at least (2 * code - 1) / 510.
bool Reaches(float v, int code) {
  int exponent;
  const auto mantissa = uint64_t(std::ldexp(std::frexp(v, &exponent), 24));  // v = mantissa * 2^(exponent - 24)
  const int down = 24 - exponent;
  const int64_t twice = 2 * code - 1;
  if (v == 0 || down < 0 || down > 60) return v >= 1;  // no threshold lies there
  if (twice * 100000 <= 4045 * 510) {                  // v >= twice / 510 / 12.92
    return AtLeast(Times(Power(mantissa, 1), Power(510 * 1292, 1)),
                   Times(Power(uint64_t(twice) * 100, 1), Power(uint64_t{1} << down, 1)));
  }
  // v^5 >= ((twice / 510 + 0.055) / 1.055)^12
  const Digits left = Times(Power(mantissa, 5), Power(510 * 1055, 12));
  return AtLeast(left, Times(Power(uint64_t(twice) * 1000 + 55 * 510, 12), Power(uint64_t{1} << down, 5)));
}

TEST(Srgb, ThresholdsAreTheLeastFloatsOfTheirCodes) {
  for (int code = 1; code <= 255; ++code) {
    const float threshold = SrgbThreshold(code - 1);
    EXPECT_TRUE(Reaches(threshold, code)) << code;
    EXPECT_FALSE(Reaches(std::nextafter(threshold, 0.0f), code)) << code;
  }
}

TEST(Srgb, CodesCountTheThresholdsThatAreAtMostTheValue) {
  EXPECT_EQ(LinearToSrgb(-1), 0u);
  EXPECT_EQ(LinearToSrgb(-HUGE_VAL), 0u);
  EXPECT_EQ(LinearToSrgb(std::nan("")), 0u);
  EXPECT_EQ(LinearToSrgb(HUGE_VAL), 255u);
  for (int code = 1; code <= 255; ++code) {
    const double threshold = SrgbThreshold(code - 1);
    EXPECT_EQ(LinearToSrgb(threshold), unsigned(code));
    EXPECT_EQ(LinearToSrgb(std::nextafter(threshold, 0.0)), unsigned(code - 1));
  }
}

TEST(Srgb, EncodingAndDecodingAreInverse) {
  for (int code = 0; code <= 255; ++code) {
    EXPECT_EQ(LinearToSrgb(SrgbToLinear(static_cast<unsigned char>(code))), unsigned(code));
  }
}

TEST(Srgb, ComponentsAreEncodedOnceAndAlphaStaysLinear) {
  constexpr VoxelFormat kSrgb = VoxelFormat::kU8Srgb;
  FragmentOutput out;
  out.f[0] = 0.5f;
  out.f[3] = 0.5f;
  EXPECT_EQ(ToCell(out, false, 0, kSrgb, 1), 188u);
  EXPECT_EQ(ToCell(out, false, 3, kSrgb, 1), 128u);  // 127.5
  const double quantum = 0x1p-20;
  const int64_t half = ToTerm(out, false, 0, kSrgb, 1, quantum);
  EXPECT_EQ(half, 1 << 19);
  EXPECT_EQ(StoreSum(half, kSrgb, quantum, 2), 188u);
  EXPECT_EQ(StoreSum(2 * half, kSrgb, quantum, 2), 255u) << "of the sum, not the sum of codes";
  EXPECT_EQ(StoreAverage(half, 2, kSrgb, quantum, 1), 137u);  // of 0.25
  EXPECT_EQ(StoreAverage(half, 2, kSrgb, quantum, 3), 64u);   // 63.75
  EXPECT_EQ(StoreSum(-half, kSrgb, quantum, 0), 0u);
  EXPECT_EQ(NumberToCell(200.6, kSrgb), 201u) << "clear and fill are codes";
}

}  // namespace
}  // namespace voxelpipe
