// Conversion of shader outputs to target values, and blending. Every blend is independent of the order of fragments, but
// for replace, which takes them by ascending triangle id.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "base/vec.h"
#include "shaders/fragment.h"

namespace voxelpipe {

// Component i as f32: u32 outputs are rounded to nearest even; NaN becomes 0.
VOXELPIPE_HD float ToF32(const FragmentOutput& out, bool is_u32, int i) {
  const float v = is_u32 ? float(out.u[i]) : out.f[i];
  return v == v ? v : 0.0f;
}

// bit: the first component is not 0; NaN counts as 0.
VOXELPIPE_HD bool ToBit(const FragmentOutput& out, bool is_u32) {
  if (is_u32) return out.u[0] != 0;
  return out.f[0] != 0 && out.f[0] == out.f[0];
}

// Total order of the values that targets hold: as <, and -0 before +0.
VOXELPIPE_HD bool OrderedLess(float a, float b) {
  if (a < b) return true;
  if (a > b) return false;
  uint32_t bits_a, bits_b;
  memcpy(&bits_a, &a, sizeof a);
  memcpy(&bits_b, &b, sizeof b);
  return (bits_a >> 31) > (bits_b >> 31);
}
VOXELPIPE_HD float BlendMin(float kept, float v) {
  return OrderedLess(v, kept) ? v : kept;
}
VOXELPIPE_HD float BlendMax(float kept, float v) {
  return OrderedLess(kept, v) ? v : kept;
}

// Float add: v clamped to +-2^40 q and rounded to the nearest (even) multiple of q, as that multiple.
VOXELPIPE_HD int64_t Quantize(float v, double quantum) {
  const double scaled = Clamp(double(v) / quantum, -0x1p40, 0x1p40);
  return int64_t((scaled + 0x1.8p52) - 0x1.8p52);  // the magic number rounds to nearest even
}

// The sum of multiples of q, converted once: an integer rounded to f32, times a power of two.
VOXELPIPE_HD float Dequantize(int64_t sum, double quantum) {
  return float(double(float(sum)) * quantum);
}

}  // namespace voxelpipe
