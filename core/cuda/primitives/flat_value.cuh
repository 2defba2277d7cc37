// Shades targets whose value is the same for all fragments of a triangle, once per triangle. No host-only includes.
#pragma once

#include "cuda/primitives/flat_shading.h"
#include "raster/triangle_plane.h"
#include "shaders/interface/fragment_input.h"

namespace voxelpipe::cuda {

// What a triangle blends into each of its voxels: cells in the accumulator's encoding, or terms of a sum.
struct UniformValue {
  int64_t component[4];
};

// The shader and its input are separate parameters: if they are compile-time constants, little of the shading remains.
__device__ __forceinline__ void ShadeUniformAs(const FlatShading& args, FragmentShaderId shader,
                                               const FragmentInput& in, UniformValue& value) {
  const CudaTarget& target = args.target;
  FragmentOutput out;
  ShadeFragment(shader, in, target.params, out);
#pragma unroll
  for (int c = 0; c < 4; ++c) {
    value.component[c] = 0;
    if (c >= target.components) continue;
    switch (args.kept) {
      case Kept::kBitOr: value.component[c] = target.blend == Blend::kCount || ToBit(out, target.u32_output); break;
      case Kept::kBitAnd: value.component[c] = ToBit(out, target.u32_output); break;
      case Kept::kSum:
      case Kept::kAverage:
        value.component[c] = ToTerm(out, target.u32_output, c, target.format, target.scale, target.quantum);
        break;
      case Kept::kCount: break;
      default: {
        const uint32_t cell = ToCell(out, target.u32_output, c, target.format, target.scale);
        const bool ordered = args.is_float && (args.kept == Kept::kMin || args.kept == Kept::kMax);
        value.component[c] = int64_t(ordered ? KeyOf(cell) : cell);
      }
    }
  }
}

}  // namespace voxelpipe::cuda
