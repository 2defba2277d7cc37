// A row writer (emit_spans.cuh) that blends the rows of deferred triangles into a dense target immediately, for targets
// that FindCells (coverage_pass.cuh) blends itself. No host-only includes.
#pragma once

#include "cuda/coverage/atomic_blend.cuh"
#include "cuda/coverage/emit_spans.cuh"

namespace voxelpipe::cuda {

struct BlendWriterArgs {
  SpanArgs cover;  // without a list
  InPlaceArgs blend;
};

// kShader: as for KeysOf.
template <int kShader, int kComponents = 1>
class BlendWriter {
 public:
  using Args = BlendWriterArgs;
  static constexpr bool kPartsInRow = false;
  __device__ BlendWriter(const BlendWriterArgs& args, uint32_t)
      : args_(args), plain_(args.blend.negative != nullptr && (kShader >= 0 || *args.blend.negative == 0)) {}

  __device__ void Put(uint32_t t, uint32_t row, int x_begin, int x_end) {
    uint32_t key[kComponents] = {};
    const uint32_t length = x_begin < x_end ? uint32_t(x_end - x_begin) : 0;
    if (length > 0) KeysOf<kShader, kComponents>(args_.blend, plain_, t, key);
    fragments_ += length;
    ForEachSpan(args_.cover.grid, t, row, x_begin, x_end, [&](uint32_t lanes, uint64_t span) {
      if ((lanes >> threadIdx.x % 32 & 1) != 0) CoverSpan(args_.cover, span);
    });
    const uint64_t first = uint64_t{row} * args_.blend.nx + uint32_t(x_begin);
    ForEachVoxel(length, [&](int owner, uint32_t x, bool there) {
      const uint64_t n = __shfl_sync(~0u, first, owner) + x;
      uint32_t of[kComponents];
#pragma unroll
      for (int c = 0; c < kComponents; ++c) of[c] = __shfl_sync(~0u, key[c], owner);
      if (there) BlendAt<kComponents>(args_.blend, n, of, 1);
    });
  }
  __device__ void Finish() {
    __syncwarp();
    AddFragments(args_.cover.fragments, fragments_);
  }

 private:
  const BlendWriterArgs& args_;
  bool plain_;
  uint64_t fragments_ = 0;
};

}  // namespace voxelpipe::cuda
