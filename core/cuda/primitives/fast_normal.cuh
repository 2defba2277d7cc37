// A triangle's unit normal in fewer steps than the shared arithmetic takes, and the same bits. No host-only includes.
#pragma once

#include <cmath>
#include <cstdint>

#include "shaders/interface/fragment.h"

namespace voxelpipe::cuda {

// Of what a double's low word holds beyond a float: at most 2 * kDoubt where it is about half. Half of kDoubt would do.
inline constexpr uint32_t kDoubt = 64;
__device__ inline uint32_t BehindHalf(double v) {
  constexpr uint32_t kHalf = 1u << 28;
  return (uint32_t(__double2loint(v)) & (2 * kHalf - 1)) - (kHalf - kDoubt);
}
// The high word without the sign. Numbers below kFewBits have fewer bits as floats.
inline constexpr uint32_t kFewBits = (1023u - 120) << 20;
__device__ inline uint32_t HighOf(double v) {
  return uint32_t(__double2hiint(v)) & 0x7fffffff;
}

// Whether every number within 2^-47 of v, relative to v, rounds to the same float.
__device__ inline bool RoundsSurely(double v) {
  const auto low = uint32_t(__double2loint(v)), high = HighOf(v);
  const bool near_half = BehindHalf(v) <= 2 * kDoubt;
  return !near_half && (high >= kFewBits || (high | low) == 0);
}

// 0 where all components do; few steps where none is close to 0.
__device__ inline uint32_t InDoubt(double x, double y, double z) {
  const uint32_t nearest = min(BehindHalf(x), min(BehindHalf(y), BehindHalf(z)));
  const uint32_t least = min(HighOf(x), min(HighOf(y), HighOf(z)));
  uint32_t doubt = nearest <= 2 * kDoubt ? 1 : 0;
  if (least < kFewBits) doubt = RoundsSurely(x) && RoundsSurely(y) && RoundsSurely(z) ? 0 : 1;
  return doubt;
}

// Apart from its caller: few triangles need it.
__device__ __noinline__ inline Vec3f NormalizedPlainly(const Vec3d& v) {
  return Normalized(v);
}

// Of a number whose float is neither 0 nor denormal nor infinite, to 2^-22.
__device__ inline float RoughInverseRoot(float v) {
#if defined(__CUDA_ARCH__)
  float root;
  asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(root) : "f"(v));
  return root;
#else
  return rsqrtf(v);
#endif
}

// Normalized: that divides and takes a root, each with an error below 2^-53 of its result, 2^-50 in all. Here the
// inverse of the length is made from one in floats by a step that leaves the cube of its error (A. S. Householder, "The
// Numerical Treatment of a Single Nonlinear Equation", 1970), and what comes out is off by less than 2^-50, too. So
// both round to the same floats but where some component lies that close to the middle between two. Not 0 where that is
// not certain, or the square of the length is less than `least`, which is at least 2^-120. It has to be at most 2^100.
__device__ inline uint32_t NormalizeQuickly(const Vec3d& v, double least, Vec3f& unit) {
  const double square = fma(v.z, v.z, fma(v.y, v.y, v.x * v.x));
  const double y = double(RoughInverseRoot(float(square)));
  const double off = fma(-(square * y), y, 1.0);
  const double inverse = fma(y * off, fma(off, 0.375, 0.5), y);
  const double x_unit = v.x * inverse, y_unit = v.y * inverse, z_unit = v.z * inverse;
  unit = {float(x_unit), float(y_unit), float(z_unit)};
  return (square >= least ? 0 : 1) | InDoubt(x_unit, y_unit, z_unit);
}
__device__ inline Vec3f QuickNormalized(const Vec3d& v) {
  Vec3f unit;
  const bool usual = fma(v.z, v.z, fma(v.y, v.y, v.x * v.x)) <= 0x1p100;
  return usual && NormalizeQuickly(v, 0x1p-100, unit) == 0 ? unit : NormalizedPlainly(v);
}

// TriangleNormal.
__device__ inline Vec3f QuickNormal(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  return QuickNormalized(Cross(b - a, c - a));
}

}  // namespace voxelpipe::cuda
