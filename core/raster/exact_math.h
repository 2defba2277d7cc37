// Arithmetic with known error, for float and double alike.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "base/vec.h"

namespace voxelpipe {

// a*b + c, rounded once.
VOXELPIPE_HD float FusedMultiplyAdd(float a, float b, float c) {
  return fmaf(a, b, c);
}
VOXELPIPE_HD double FusedMultiplyAdd(double a, double b, double c) {
  return fma(a, b, c);
}

VOXELPIPE_HD float Ceil(float v) {
  return ceilf(v);
}
VOXELPIPE_HD double Ceil(double v) {
  return ceil(v);
}
VOXELPIPE_HD float Floor(float v) {
  return floorf(v);
}
VOXELPIPE_HD double Floor(double v) {
  return floor(v);
}

// a*b - c*d within 1.5 ulp of the result (W. Kahan; Jeannerod, Louvet, Muller, "Further analysis of Kahan's algorithm
// for the accurate computation of 2x2 determinants", 2013).
template <typename Real>
VOXELPIPE_HD Real DifferenceOfProducts(Real a, Real b, Real c, Real d) {
  const Real cd = c * d;
  const Real error = FusedMultiplyAdd(-c, d, cd);
  return FusedMultiplyAdd(a, b, -cd) + error;
}

template <typename Real>
VOXELPIPE_HD Vec3<Real> AccurateCross(const Vec3<Real>& a, const Vec3<Real>& b) {
  return {DifferenceOfProducts(a.y, b.z, a.z, b.y), DifferenceOfProducts(a.z, b.x, a.x, b.z),
          DifferenceOfProducts(a.x, b.y, a.y, b.x)};
}

template <typename Real>
VOXELPIPE_HD Real MaxAbs(const Vec3<Real>& v) {
  return Max(Abs(v.x), Max(Abs(v.y), Abs(v.z)));
}

// The smallest power of two above a positive normal v, by its exponent bits.
VOXELPIPE_HD double PowerOfTwoAbove(double v) {
  uint64_t bits;
  memcpy(&bits, &v, sizeof bits);
  bits = ((bits >> 52) + 1) << 52;
  double power;
  memcpy(&power, &bits, sizeof power);
  return power;
}

// v rounded to multiples of a quantum. In: `magic`, 1.5 x 2^52 times the quantum.
VOXELPIPE_HD Vec3d RoundTo(const Vec3d& v, double magic) {
  return {(v.x + magic) - magic, (v.y + magic) - magic, (v.z + magic) - magic};
}

}  // namespace voxelpipe
