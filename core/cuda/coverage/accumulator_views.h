// Kernel views of accumulators: the intermediate state of a covered voxel while its fragments are blended. No host-only
// includes.
#pragma once

#include "cuda/primitives/blend_rules.h"

namespace voxelpipe::cuda {

// Accumulators indexed by rank, with `components` per voxel. Only the arrays that the Kept kind needs are set.
struct Accumulators {
  Kept kept{};
  int components = 1;
  uint32_t* cells = nullptr;
  unsigned long long* sums = nullptr;
  uint32_t* counts = nullptr;  // one per voxel
};

// A target and its accumulators. If one fragment replaces others, the accumulator holds the owner's triangle id + 1.
struct ShadedTarget {
  CudaTarget target;
  Accumulators to;
  bool has_owner = false, is_float = false;
};

VOXELPIPE_HD bool IsFloat(VoxelFormat format) {
  return format == VoxelFormat::kF16 || format == VoxelFormat::kF32;
}
VOXELPIPE_HD bool IsSum(Kept kept) {
  return kept == Kept::kSum || kept == Kept::kAverage;
}
VOXELPIPE_HD bool HasOwner(const CudaTarget& target) {
  return target.blend == Blend::kReplace || target.blend == Blend::kFirst;
}
// True if cells start with all bits set; otherwise they start at 0.
VOXELPIPE_HD bool BeginsWithOnes(Kept kept) {
  return kept == Kept::kMin || kept == Kept::kAnd;
}
// The accumulators of a target, without memory: owner targets accumulate triangle numbers, bit targets cells that are 0
// or 1.
VOXELPIPE_HD Accumulators ShapeOf(const CudaTarget& target) {
  Accumulators shape;
  const Kept kept = KeptBy(target);
  switch (kept) {
    case Kept::kBitOr: shape.kept = Kept::kOr; break;
    case Kept::kBitAnd: shape.kept = Kept::kAnd; break;
    case Kept::kOwner:
    case Kept::kBitOfOwner: shape.kept = target.blend == Blend::kFirst ? Kept::kMin : Kept::kMax; break;
    default: shape.kept = kept;
  }
  shape.components = HasOwner(target) || target.format == VoxelFormat::kBit ? 1 : target.components;
  return shape;
}

// A target whose fragments are shaded.
inline ShadedTarget ShadedTargetOf(const CudaTarget& target, const Accumulators& to) {
  ShadedTarget shaded;
  shaded.target = target;
  shaded.to = to;
  shaded.has_owner = HasOwner(target);
  shaded.is_float = IsFloat(target.format);
  return shaded;
}

}  // namespace voxelpipe::cuda
