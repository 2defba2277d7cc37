// How fragments are blended on a device: in any order, so every blend is an atomic whose result no order changes. Floats
// are kept as keys whose unsigned order is theirs. No host-only includes.
#pragma once

#include "cuda/primitives/views.h"
#include "shaders/blend_ops.h"

namespace voxelpipe::cuda {

// What is kept of a voxel.
enum class Kept : uint8_t {
  kNothing,     // the coverage itself
  kBitOr,       // a bit, set where any fragment's is
  kBitAnd,      // a bit, clear where any fragment's is
  kBitOfOwner,  // a bit, of the owner
  kOwner,       // cells, of the owner
  kMin,         // cells; floats as keys
  kMax,
  kOr,
  kAnd,
  kSum,      // 64 bits a component
  kAverage,  // likewise, and the number of fragments
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
// True if what is kept of a voxel is blended from values alone, whichever triangle they are of.
VOXELPIPE_HD bool IsUniformKept(Kept kept) {
  return kept != Kept::kNothing && kept != Kept::kOwner && kept != Kept::kBitOfOwner;
}

// Unsigned order of keys is the order of OrderedLess (blend_ops.h).
VOXELPIPE_HD uint32_t KeyOf(uint32_t float_bits) {
  return (float_bits >> 31) != 0 ? ~float_bits : float_bits | 0x80000000u;
}
VOXELPIPE_HD uint32_t BitsOfKey(uint32_t key) {
  return (key >> 31) != 0 ? key & 0x7fffffffu : ~key;
}

}  // namespace voxelpipe::cuda
