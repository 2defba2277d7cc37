// Conversion of shader outputs to target values, and blending: one definition for both devices.
//
// A fragment's output is first converted to the target's format, then blended. Only `add` and `average` into f16 blend
// the f32 value, rounded to a multiple of the quantum, and round to f16 once, at the end. Every blend is independent of
// the order of fragments, except replace and first, which order them by ascending triangle id. A component is
// accumulated as
//   a cell   32 bits: the integer, or the bits of the f32 (f16 values as the f32 of the same value): replace first min
//            max and or
//   a sum    64 bits: integers, or multiples of the quantum: add average
//   a count  the number of the voxel's fragments: count average
// and converted to the format once, when it is stored.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "base/vec.h"
#include "grid/formats.h"
#include "shaders/interface/fragment.h"
#include "shaders/texture/srgb.h"

namespace voxelpipe {

VOXELPIPE_HD uint32_t BitsOf(float v) {
  uint32_t bits;
  memcpy(&bits, &v, sizeof bits);
  return bits;
}
VOXELPIPE_HD float FloatOf(uint32_t bits) {
  float v;
  memcpy(&v, &bits, sizeof v);
  return v;
}

// ---- conversion ----

// IEEE binary16 of v, nearest even, overflow to infinity, NaN to 0.
VOXELPIPE_HD uint16_t HalfBits(double v) {
  if (!(v == v)) return 0;
  uint64_t bits;
  memcpy(&bits, &v, sizeof bits);
  const auto sign = uint16_t(bits >> 48 & 0x8000);
  const double a = v < 0 ? -v : v;
  if (a >= 65520.0) return sign | 0x7c00;  // halfway above the largest finite, 65504
  if (a < 0x1p-14) {                       // subnormal: a multiple of 2^-24, rounded by the magic number
    return sign | uint16_t((a * 0x1p24 + 0x1.8p52) - 0x1.8p52);
  }
  memcpy(&bits, &a, sizeof bits);
  const uint64_t kept = bits >> 42, rest = bits & ((uint64_t{1} << 42) - 1), half = uint64_t{1} << 41;
  const uint64_t rounded = kept + (rest > half || (rest == half && (kept & 1) != 0));
  return sign | uint16_t(rounded - (uint64_t{1023 - 15} << 10));
}

VOXELPIPE_HD float FromHalf(uint16_t bits) {
  const uint32_t sign = uint32_t(bits & 0x8000) << 16, exponent = bits >> 10 & 31, mantissa = bits & 1023;
  if (exponent == 31) return FloatOf(sign | 0x7f800000u | mantissa << 13);
  if (exponent == 0) {
    const float v = float(mantissa) * 0x1p-24f;
    return sign != 0 ? -v : v;
  }
  return FloatOf(sign | (exponent + 112) << 23 | mantissa << 13);
}

// Nearest even, saturated to [0, most]; NaN becomes 0.
VOXELPIPE_HD uint32_t ToUnsigned(double v, uint32_t most) {
  if (!(v > 0)) return 0;
  if (v >= double(most)) return most;
  return uint32_t((v + 0x1.8p52) - 0x1.8p52);
}

// Largest value of an integer format, 0 for others.
VOXELPIPE_HD uint32_t LargestInteger(VoxelFormat format) {
  switch (format) {
    case VoxelFormat::kU8:
    case VoxelFormat::kU8Srgb:
    case VoxelFormat::kU8Snorm: return 0xff;
    case VoxelFormat::kU16:
    case VoxelFormat::kU16Snorm: return 0xffff;
    case VoxelFormat::kU32: return 0xffffffffu;
    default: return 0;
  }
}
VOXELPIPE_HD bool IsInteger(VoxelFormat format) {
  return LargestInteger(format) != 0;
}
// True if Encode makes the format's values.
VOXELPIPE_HD bool IsEncoded(VoxelFormat format) {
  return format == VoxelFormat::kU8Srgb || format == VoxelFormat::kU8Snorm || format == VoxelFormat::kU16Snorm;
}
// True if sums are multiples of the quantum: for float formats, and for encoded ones, which are encoded after summing.
VOXELPIPE_HD bool SumsFloats(VoxelFormat format) {
  return !IsInteger(format) || IsEncoded(format);
}

// Component i of an encoded format. sRGB: colours by the transfer function, the fourth component times 255. Snorm: -1
// to 1 as 0 to the largest integer.
VOXELPIPE_HD uint32_t Encode(VoxelFormat format, double v, int i) {
  if (format == VoxelFormat::kU8Srgb) return i < 3 ? LinearToSrgb(v) : ToUnsigned(v * 255, 255);
  const uint32_t most = LargestInteger(format);
  return ToUnsigned((v / 2 + 0.5) * double(most), most);
}

// Component i as f32: u32 outputs are rounded to nearest even; NaN becomes 0.
VOXELPIPE_HD float ToF32(const FragmentOutput& out, bool is_u32, int i) {
  const float v = is_u32 ? float(out.u[i]) : out.f[i];
  return v == v ? v : 0.0f;
}

// Component i for an integer format: f32 outputs times scale, nearest even, saturated; u32 outputs saturated.
VOXELPIPE_HD uint32_t ToInteger(const FragmentOutput& out, bool is_u32, int i, double scale, uint32_t most) {
  if (is_u32) return out.u[i] < most ? out.u[i] : most;
  return ToUnsigned(double(out.f[i]) * scale, most);
}

// bit: the first component is not 0; NaN counts as 0.
VOXELPIPE_HD bool ToBit(const FragmentOutput& out, bool is_u32) {
  if (is_u32) return out.u[0] != 0;
  return out.f[0] != 0 && out.f[0] == out.f[0];
}

// Component i as a cell of a format other than bit.
VOXELPIPE_HD uint32_t ToCell(const FragmentOutput& out, bool is_u32, int i, VoxelFormat format, double scale) {
  if (IsEncoded(format)) return Encode(format, double(ToF32(out, is_u32, i)), i);
  if (IsInteger(format)) return ToInteger(out, is_u32, i, scale, LargestInteger(format));
  if (format == VoxelFormat::kF32) return BitsOf(ToF32(out, is_u32, i));
  // From the u32 itself: through f32 it would be rounded twice.
  return BitsOf(FromHalf(HalfBits(is_u32 ? double(out.u[i]) : double(out.f[i]))));
}

// A number as a cell: clear and fill values. Saturated, nearest even; not scaled.
VOXELPIPE_HD uint32_t NumberToCell(double v, VoxelFormat format) {
  if (format == VoxelFormat::kBit) return v != 0;
  if (IsInteger(format)) return ToUnsigned(v, LargestInteger(format));
  return BitsOf(format == VoxelFormat::kF32 ? float(v) : FromHalf(HalfBits(v)));
}

// A cell as it is stored: the low 8, 16 or 32 bits.
VOXELPIPE_HD uint32_t StoredBits(uint32_t cell, VoxelFormat format) {
  return format == VoxelFormat::kF16 ? HalfBits(double(FloatOf(cell))) : cell;
}

// ---- blending ----

// Total order of the values that targets hold: as <, and -0 before +0.
VOXELPIPE_HD bool OrderedLess(float a, float b) {
  if (a < b) return true;
  if (a > b) return false;
  return (BitsOf(a) >> 31) > (BitsOf(b) >> 31);
}
VOXELPIPE_HD float BlendMin(float kept, float v) {
  return OrderedLess(v, kept) ? v : kept;
}
VOXELPIPE_HD float BlendMax(float kept, float v) {
  return OrderedLess(kept, v) ? v : kept;
}

// Blends the cell `v` of a further fragment, of a higher triangle id, into the voxel's cell `kept`. For blends that
// accumulate a cell.
VOXELPIPE_HD uint32_t BlendCell(Blend blend, bool is_float, uint32_t kept, uint32_t v) {
  switch (blend) {
    case Blend::kReplace: return v;
    case Blend::kMin:
      if (is_float) return BitsOf(BlendMin(FloatOf(kept), FloatOf(v)));
      return v < kept ? v : kept;
    case Blend::kMax:
      if (is_float) return BitsOf(BlendMax(FloatOf(kept), FloatOf(v)));
      return v < kept ? kept : v;
    case Blend::kOr: return kept | v;
    case Blend::kAnd: return kept & v;
    default: return kept;  // first
  }
}

// The same for bits.
VOXELPIPE_HD bool BlendBit(Blend blend, bool kept, bool v) {
  switch (blend) {
    case Blend::kReplace: return v;
    case Blend::kAnd: return kept && v;
    case Blend::kFirst: return kept;
    default: return kept || v;  // or
  }
}

// Float add: v clamped to +-2^40 q and rounded to the nearest (even) multiple of q, as that multiple.
VOXELPIPE_HD int64_t Quantize(float v, double quantum) {
  const double scaled = Clamp(double(v) / quantum, -0x1p40, 0x1p40);
  return int64_t((scaled + 0x1.8p52) - 0x1.8p52);  // the magic number rounds to nearest even
}

// The term that a fragment adds to its voxel's sum: the integer, or the f32 value as a multiple of the quantum (every
// float format, and those with an encoding).
VOXELPIPE_HD int64_t ToTerm(const FragmentOutput& out, bool is_u32, int i, VoxelFormat format, double scale,
                            double quantum) {
  if (!SumsFloats(format)) return int64_t(ToInteger(out, is_u32, i, scale, LargestInteger(format)));
  return Quantize(ToF32(out, is_u32, i), quantum);
}

// The sum of multiples of q, converted once: an integer rounded to f32, times a power of two.
VOXELPIPE_HD float Dequantize(int64_t sum, double quantum) {
  return float(double(float(sum)) * quantum);
}

// A double that rounds to every format as `sum` itself does: exact, or beyond 2^53 with its last bit set if bits were
// lost (rounding to odd).
VOXELPIPE_HD double RoundToOdd(int64_t sum) {
  const bool negative = sum < 0;
  uint64_t m = negative ? uint64_t{0} - uint64_t(sum) : uint64_t(sum);
  double scale = 1;
  if (m >> 53 != 0) {
    m = (m >> 11) | ((m & 0x7ff) != 0);
    scale = 0x1p11;
  }
  const double v = double(m) * scale;
  return negative ? -v : v;
}

// A sum of component i as stored: integers saturate, floats are converted once.
VOXELPIPE_HD uint32_t StoreSum(int64_t sum, VoxelFormat format, double quantum, int i = 0) {
  if (IsEncoded(format)) return Encode(format, RoundToOdd(sum) * quantum, i);
  if (IsInteger(format)) {
    const uint64_t total = uint64_t(sum), most = LargestInteger(format);
    return uint32_t(total < most ? total : most);
  }
  if (format == VoxelFormat::kF32) return BitsOf(Dequantize(sum, quantum));
  return HalfBits(RoundToOdd(sum) * quantum);
}

// The average of component i as stored: the sum over the count in double, converted once.
VOXELPIPE_HD uint32_t StoreAverage(int64_t sum, uint32_t count, VoxelFormat format, double quantum, int i = 0) {
  if (!SumsFloats(format)) return ToUnsigned(double(uint64_t(sum)) / double(count), LargestInteger(format));
  const double average = double(sum) * quantum / double(count);
  if (IsEncoded(format)) return Encode(format, average, i);
  return format == VoxelFormat::kF32 ? BitsOf(float(average)) : HalfBits(average);
}

// The count as stored.
VOXELPIPE_HD uint32_t StoreCount(uint32_t count, VoxelFormat format) {
  if (IsInteger(format)) return count < LargestInteger(format) ? count : LargestInteger(format);
  return format == VoxelFormat::kF32 ? BitsOf(float(count)) : HalfBits(double(count));
}

}  // namespace voxelpipe
