// Blends a shaded fragment into the accumulators of its voxel by order-independent atomics. No host-only includes.
#pragma once

#include "cuda/coverage/accumulators.cuh"

namespace voxelpipe::cuda {

// Blends a fragment that was not discarded.
__device__ inline void BlendShaded(const ShadedTarget& shaded, const FragmentOutput& out, uint32_t triangle,
                                   uint32_t rank) {
  const CudaTarget& target = shaded.target;
  const Accumulators& to = shaded.to;
  if (shaded.has_owner) {
    if (to.kept == Kept::kMax) {
      atomicMax(to.cells + rank, OwnerOf(triangle));
    } else {
      atomicMin(to.cells + rank, OwnerOf(triangle));
    }
    return;
  }
  if (to.kept == Kept::kCount || to.kept == Kept::kAverage) atomicAdd(to.counts + rank, 1u);
  if (to.kept == Kept::kCount) return;
  const bool bit = target.format == VoxelFormat::kBit;
  for (int c = 0; c < to.components; ++c) {
    const uint64_t at = uint64_t{rank} * uint64_t(to.components) + uint64_t(c);
    if (to.kept == Kept::kSum || to.kept == Kept::kAverage) {
      const int64_t term = ToTerm(out, target.u32_output, c, target.format, target.scale, target.quantum);
      if (term != 0) atomicAdd(to.sums + at, static_cast<unsigned long long>(term));
      continue;
    }
    uint32_t cell;
    if (bit) {
      cell = target.blend == Blend::kCount || ToBit(out, target.u32_output);
    } else {
      cell = ToCell(out, target.u32_output, c, target.format, target.scale);
      const bool ordered = shaded.is_float && (to.kept == Kept::kMin || to.kept == Kept::kMax);
      if (ordered) cell = KeyOf(cell);
    }
    switch (to.kept) {
      case Kept::kMax: atomicMax(to.cells + at, cell); break;
      case Kept::kMin: atomicMin(to.cells + at, cell); break;
      case Kept::kOr: atomicOr(to.cells + at, cell); break;
      default: atomicAnd(to.cells + at, cell); break;
    }
  }
}

}  // namespace voxelpipe::cuda
