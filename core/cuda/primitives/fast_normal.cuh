// A triangle's unit normal, faster than the shared arithmetic and bit-identical to it: a floating-point filter with
// exact fallback. No host-only includes.
#pragma once

#include <cmath>
#include <cstdint>

#include "shaders/interface/fragment.h"

namespace voxelpipe::cuda {

// Offset of v from the midpoint between two floats, in units of the double's last place, plus kDoubt: at most 2 *
// kDoubt near a midpoint. Half of kDoubt would suffice.
inline constexpr uint32_t kDoubt = 64;
__device__ inline uint32_t BehindHalf(double v) {
  constexpr uint32_t kHalf = 1u << 28;
  return (uint32_t(__double2loint(v)) & (2 * kHalf - 1)) - (kHalf - kDoubt);
}
// The high word without the sign. Numbers below kFewBits are denormal or nearly so as floats.
inline constexpr uint32_t kFewBits = (1023u - 120) << 20;
__device__ inline uint32_t HighOf(double v) {
  return uint32_t(__double2hiint(v)) & 0x7fffffff;
}

// True if every number within a relative 2^-47 of v rounds to the same float.
__device__ inline bool RoundsSurely(double v) {
  const auto low = uint32_t(__double2loint(v)), high = HighOf(v);
  const bool near_half = BehindHalf(v) <= 2 * kDoubt;
  return !near_half && (high >= kFewBits || (high | low) == 0);
}

// 0 if RoundsSurely() holds for all components; cheap if no component is close to 0.
__device__ inline uint32_t InDoubt(double x, double y, double z) {
  const uint32_t nearest = min(BehindHalf(x), min(BehindHalf(y), BehindHalf(z)));
  const uint32_t least = min(HighOf(x), min(HighOf(y), HighOf(z)));
  uint32_t doubt = nearest <= 2 * kDoubt ? 1 : 0;
  if (least < kFewBits) doubt = RoundsSurely(x) && RoundsSurely(y) && RoundsSurely(z) ? 0 : 1;
  return doubt;
}

// Not inlined: few triangles need the exact path.
__device__ __noinline__ inline Vec3f NormalizedPlainly(const Vec3d& v) {
  return Normalized(v);
}

// 1 / sqrt(v) to 2^-22, for v that is neither 0 nor denormal nor infinite as a float.
__device__ inline float RoughInverseRoot(float v) {
#if defined(__CUDA_ARCH__)
  float root;
  asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(root) : "f"(v));
  return root;
#else
  return rsqrtf(v);
#endif
}

// Normalizes v without division and square root. Normalized() divides and takes a root, each with a relative error
// below 2^-53, below 2^-50 in all. Here a float approximation of the inverse length is refined by one step of third
// order (A. S. Householder, "The Numerical Treatment of a Single Nonlinear Equation", 1970); its relative error is
// below 2^-50, too. So both round to the same floats unless a component is that close to the midpoint of two floats.
// Returns non-zero if the result is uncertain or the squared length is below `least`, which must be at least 2^-120.
// The squared length must be at most 2^100.
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

// The fast equivalent of TriangleNormal.
__device__ inline Vec3f QuickNormal(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  return QuickNormalized(Cross(b - a, c - a));
}

}  // namespace voxelpipe::cuda
