// Blending by spans (span.h): a thread a span, in any order. No host-only includes.
//
// Where a blend is one 32-bit atomic that begins from the stored clear value 0, it is done in the dense target itself:
// min and max as keys (blend_rules.cuh), which become values at the end, or as they are where no value of a max is
// negative. Other blends go to accumulators of covered voxels, numbered by rank. What becomes of both: store_accumulators.cuh.
#pragma once

#include "cuda/coverage/accumulators.cuh"
#include "cuda/coverage/atomic_blend.cuh"
#include "cuda/coverage/span_segments.cuh"
#include "cuda/primitives/fast_divide.h"
#include "cuda/primitives/span.h"
#include "cuda/traversal/row_traversal.cuh"
#include "raster/degenerate.h"

namespace voxelpipe::cuda {

// ---- values of triangles ----

struct ShadeTrianglesArgs {
  FlatShading shading;  // of one target
  DegenerateTest degenerate;
  uint64_t triangles = 0;
  uint32_t* values = nullptr;    // `components` a triangle, as the target keeps them; or
  int64_t* terms = nullptr;      // those of sums
  uint32_t* negative = nullptr;  // values that are keys of floats: becomes 1 where one is the key of a negative number
};

// The components of triangle t's value, four of them by accesses of 16 bytes.
template <typename T>
__device__ inline void StoreComponents(const UniformValue& value, uint64_t t, uint64_t components, T* to) {
  const int64_t(&of)[4] = value.component;
  if (components == 4) {
    struct alignas(16) All {
      T of[4];
    };
    reinterpret_cast<All*>(to)[t] = {T(of[0]), T(of[1]), T(of[2]), T(of[3])};
    return;
  }
#pragma unroll
  for (uint64_t c = 0; c < 3; ++c) {
    if (c < components) to[t * components + c] = T(of[c]);
  }
}

// kShader: the target's, where the kernel is made for one; -1: any.
template <int kShader>
__global__ void __launch_bounds__(kBlendThreads) ShadeTriangles(const __grid_constant__ ShadeTrianglesArgs args) {
  const CudaTarget& target = args.shading.target;
  const auto shader = kShader >= 0 ? FragmentShaderId(kShader) : target.shader;
  const bool needs_plane = kShader >= 0 ? TraitsOf(shader).needs_plane : args.shading.traits.needs_plane;
  const auto components = uint64_t(target.components);
  const uint64_t t = uint64_t(blockIdx.x) * kBlendThreads + threadIdx.x;
  const bool has = t < args.triangles;
  FragmentInput in;
  Vec3d corners[3];
  if (has) {
    const MeshView& mesh = *args.shading.mesh;
    in = MakePlainInput(mesh, uint32_t(t));
    if (needs_plane) {
      for (int i = 0; i < 3; ++i) corners[i] = mesh.positions[in.vertex[i]];
    }
  }
  bool negative = false;
  if (has) {
    if (needs_plane) {
      in.degenerate = IsDegenerate(args.degenerate, corners[0], corners[1], corners[2]);
      if (!in.degenerate) in.geometric_normal = TriangleNormal(corners[0], corners[1], corners[2]);
    }
    UniformValue value;
    ShadeUniformAs(args.shading, shader, in, value);
    if (args.terms != nullptr) {
      StoreComponents(value, t, components, args.terms);
    } else {
      StoreComponents(value, t, components, args.values);
#pragma unroll
      for (uint64_t c = 0; c < 4; ++c) {
        negative = negative || (c < components && uint32_t(value.component[c]) >> 31 == 0);
      }
    }
  }
  if (args.negative == nullptr || __any_sync(~0u, negative) == 0) return;
  if (threadIdx.x % 32 == 0 && __ldcg(args.negative) == 0) atomicOr(args.negative, 1u);
}

// ---- in place ----

// Spans are taken from the last on: values that grow with the triangle's number, as its id does, then find their voxel
// done.
template <int kComponents, int kShader>
__global__ void __launch_bounds__(kBlendThreads) BlendInPlace(const __grid_constant__ InPlaceArgs args) {
  const bool plain = args.negative != nullptr && *args.negative == 0;  // positive floats have the order of their bits
  const uint64_t threads = uint64_t(gridDim.x) * kBlendThreads;
  const unsigned lane = threadIdx.x % 32;
  for (uint64_t begin = uint64_t(blockIdx.x) * kBlendThreads + threadIdx.x - lane; begin < args.count;
       begin += threads) {
    const uint64_t span = begin + lane < args.count ? args.spans[args.count - 1 - begin - lane] : kNoSpan;
    const LaneRun run = FindRun(span);
    uint32_t value[kComponents] = {};
    if (span != kNoSpan) KeysOf<kShader, kComponents>(args, plain, args.first_triangle + SpanTriangle(span), value);
#pragma unroll
    for (int c = 0; c < kComponents; ++c) {
      value[c] = CombineRun(run, value[c], [&](uint32_t a, uint32_t b) { return CombineKeys(args, a, b); });
    }
    const bool blends = span != kNoSpan && run.head();
    const uint64_t first = blends ? VoxelOfBit(SpanFirst(span), args.nx, args.words_per_row) : 0;
    ForEachVoxel(blends ? SpanLength(span) : 0, [&](int owner, uint32_t x, bool there) {
      const uint64_t n = __shfl_sync(~0u, first, owner) + x;
      const auto count = uint32_t(__shfl_sync(~0u, run.last - run.first + 1, owner));
      uint32_t of[kComponents];
#pragma unroll
      for (int c = 0; c < kComponents; ++c) of[c] = __shfl_sync(~0u, value[c], owner);
      if (there) BlendAt<kComponents>(args, n, of, count);
    });
  }
}

// ---- in accumulators ----

struct AccumulateArgs {
  const uint64_t* spans = nullptr;
  uint64_t count = 0;
  uint32_t first_triangle = 0;  // SpanArgs'
  const uint32_t* values = nullptr;
  const int64_t* terms = nullptr;
  FlatShading shading;  // of the target, where there are neither values nor terms
  Ranks ranks;
  Accumulators to;
};

// As ValuesOf.
template <int kShader, int kComponents>
__device__ inline void TermsOf(const AccumulateArgs& args, uint32_t t, int64_t (&to)[kComponents]) {
  if constexpr (kShader >= 0) {
    UniformValue value;
    ShadeUniformAs(args.shading, FragmentShaderId(kShader), MakePlainInput(*args.shading.mesh, t), value);
#pragma unroll
    for (int c = 0; c < kComponents; ++c) to[c] = value.component[c];
  } else {
#pragma unroll
    for (int c = 0; c < kComponents; ++c) to[c] = args.terms[uint64_t{t} * kComponents + uint64_t(c)];
  }
}
__device__ inline int64_t AddTerms(int64_t a, int64_t b) {
  return int64_t(uint64_t(a) + uint64_t(b));
}
template <int kComponents, int kShader>
__global__ void __launch_bounds__(kBlendThreads) Accumulate(const __grid_constant__ AccumulateArgs args) {
  const uint64_t threads = uint64_t(gridDim.x) * kBlendThreads;
  const Kept kept = args.to.kept;
  const bool sums = kept == Kept::kSum || kept == Kept::kAverage;
  const unsigned lane = threadIdx.x % 32;
  for (uint64_t begin = uint64_t(blockIdx.x) * kBlendThreads + threadIdx.x - lane; begin < args.count;
       begin += threads) {
    const uint64_t span = begin + lane < args.count ? args.spans[args.count - 1 - begin - lane] : kNoSpan;
    const LaneRun run = FindRun(span);
    const uint32_t triangle = args.first_triangle + SpanTriangle(span);
    int64_t term[kComponents] = {};
    uint32_t value[kComponents] = {};
    if (sums) {
      if (span != kNoSpan) TermsOf<kShader, kComponents>(args, triangle, term);
#pragma unroll
      for (int c = 0; c < kComponents; ++c) term[c] = CombineRun(run, term[c], AddTerms);
    } else if (kept != Kept::kCount) {
      if (span != kNoSpan) ValuesOf<kShader, kComponents>(args.values, args.shading, triangle, value);
#pragma unroll
      for (int c = 0; c < kComponents; ++c) {
        value[c] = CombineRun(run, value[c], [&](uint32_t a, uint32_t b) { return CombineCells(kept, a, b); });
      }
    }
    const bool blends = span != kNoSpan && run.head();
    const uint32_t first = SpanFirst(span);
    ForEachVoxel(blends ? SpanLength(span) : 0, [&](int owner, uint32_t x, bool there) {
      const uint32_t at = __shfl_sync(~0u, first, owner) + x;
      const auto count = uint32_t(__shfl_sync(~0u, run.last - run.first + 1, owner));
      const auto add = [&]<typename T>(const T(&of_lane)[kComponents]) {
        T of[kComponents];
#pragma unroll
        for (int c = 0; c < kComponents; ++c) of[c] = __shfl_sync(~0u, of_lane[c], owner);
        if (there) AddAt<kComponents>(args.to, args.ranks.Of(at / 32, at % 32), of, count);
      };
      if (sums) {
        add(term);
      } else {
        add(value);
      }
    });
  }
}

}  // namespace voxelpipe::cuda
