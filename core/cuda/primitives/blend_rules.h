// Blend rules on a device. Fragments arrive in any order, so every blend is an order-independent atomic. Floats are
// kept as keys: an order-preserving unsigned encoding. No host-only includes.
#pragma once

#include "cuda/primitives/views.h"
#include "shaders/blend_ops.h"

namespace voxelpipe::cuda {

// The accumulator kind: what is stored per voxel while fragments are blended.
enum class Kept : uint8_t {
  kNothing,     // nothing: the coverage is the value
  kBitOr,       // a bit, set if any fragment's is set
  kBitAnd,      // a bit, clear if any fragment's is clear
  kBitOfOwner,  // one bit of the owner (the triangle that wins the voxel)
  kOwner,       // the owner's value, in 32-bit cells
  kMin,         // 32-bit cells; floats as keys
  kMax,
  kOr,
  kAnd,
  kSum,      // 64 bits per component
  kAverage,  // 64 bits per component, and the number of fragments
  kCount,    // the number of fragments
};

VOXELPIPE_HD Kept KeptBy(const CudaTarget& t) {
  if (t.is_occupancy) return Kept::kNothing;
  const bool bit = t.format == VoxelFormat::kBit;
  switch (t.blend) {
    case Blend::kOr: return bit ? Kept::kBitOr : Kept::kOr;
    case Blend::kAnd: return bit ? Kept::kBitAnd : Kept::kAnd;
    case Blend::kReplace:
    case Blend::kFirst: return bit ? Kept::kBitOfOwner : Kept::kOwner;
    case Blend::kMin: return Kept::kMin;
    case Blend::kMax: return Kept::kMax;
    case Blend::kAdd: return Kept::kSum;
    case Blend::kAverage: return Kept::kAverage;
    case Blend::kCount: return bit ? Kept::kBitOr : Kept::kCount;
  }
  return Kept::kNothing;
}
// True if the result depends on fragment values alone, not on which triangles they come from.
VOXELPIPE_HD bool IsUniformKept(Kept kept) {
  return kept != Kept::kNothing && kept != Kept::kOwner && kept != Kept::kBitOfOwner;
}

// Order-preserving encoding: unsigned order of keys is the order of OrderedLess (blend_ops.h).
VOXELPIPE_HD uint32_t KeyOf(uint32_t float_bits) {
  return (float_bits >> 31) != 0 ? ~float_bits : float_bits | 0x80000000u;
}
VOXELPIPE_HD uint32_t BitsOfKey(uint32_t key) {
  return (key >> 31) != 0 ? key & 0x7fffffffu : ~key;
}

}  // namespace voxelpipe::cuda
