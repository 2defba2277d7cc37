// The formats, encodings and blends of render targets: enumerations alone, for device code too.
#pragma once

#include <cstdint>

namespace voxelpipe {

enum class VoxelFormat : uint8_t {
  kBit,  // bit n of the linear order is (byte[n/8] >> (n%8)) & 1, no row padding, unused bits 0
  kU8,   // unsigned integers and IEEE binary16/32, little endian
  kU16,
  kU32,
  kF16,
  kF32,
  // Targets with an encoding within the stages (pipeline/stages/target_rules.h); not for requests.
  kU8Srgb,
  kU8Snorm,
  kU16Snorm,
};

// The encoding of the values of a u8 or u16 target.
enum class Encoding : uint8_t {
  kLinear,
  kSrgb,   // colours, u8: components 0 to 2 by the transfer function (shaders/texture/srgb.h), the fourth times 255
  kSnorm,  // normals and tangents, u8 or u16: -1 to 1 as 0 to 255 or 65535, (v/2 + 0.5) times that, nearest even
};

// All blends are independent of the order in which triangles arrive. Component by component.
enum class Blend : uint8_t {
  kOr,       // bit: 1 if any fragment's value is not 0; integers: bitwise
  kReplace,  // the fragment of the largest triangle id wins
  kMin,      // -0 < +0
  kMax,      // -0 < +0
  kAdd,  // integers: summed in u64, saturated once; floats: each value clamped to +-2^40 q, rounded to a multiple of the
         // quantum q, summed in int64, converted once
  kFirst,    // the fragment of the smallest triangle id wins
  kAverage,  // the sum of kAdd over the number of fragments, in double, converted once
  kCount,    // the number of fragments, saturated once; bit: 1 if there is any. The shader's value is ignored
  kAnd,      // bit: 1 if every fragment's value is not 0; integers: bitwise
};

}  // namespace voxelpipe
