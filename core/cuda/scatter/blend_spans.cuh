// Blends spans (span.h) in any order, one thread per span. No host-only includes.
//
// A blend that is a single 32-bit atomic starting from clear value 0 works in the dense target itself. Min and max use
// order-preserving keys (blend_rules.h), which are converted to values at the end, or plain float bits if no value of a
// max is negative. Other blends use accumulators of covered voxels, indexed by rank. store_accumulators.cuh converts
// both to results.
#pragma once

#include "cuda/coverage/accumulators.cuh"
#include "cuda/coverage/atomic_blend.cuh"
#include "cuda/coverage/span_segments.cuh"
#include "cuda/primitives/fast_divide.h"
#include "cuda/primitives/span.h"
#include "cuda/traversal/row_traversal.cuh"
#include "raster/degenerate.h"

namespace voxelpipe::cuda {

// ---- Values per triangle ----

struct ShadeTrianglesArgs {
  FlatShading shading;  // for one target
  DegenerateTest degenerate;
  uint64_t triangles = 0;
  uint32_t* values = nullptr;    // `components` per triangle, in the accumulator's encoding; or
  int64_t* terms = nullptr;      // terms of sums
  uint32_t* negative = nullptr;  // for float keys: set to 1 if some value is negative
};

// Stores the components of triangle t's value; four of them in 16-byte accesses.
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

// kShader: a specialization for the target's shader; -1: any shader.
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

// ---- In-place blending ----

// Processes spans in descending order, so that values that increase with the triangle number, like ids, usually find
// their voxel already done.
template <int kComponents, int kShader>
__global__ void __launch_bounds__(kBlendThreads) BlendInPlace(const __grid_constant__ InPlaceArgs args) {
  // Bits of non-negative floats are in the order of the floats.
  const bool plain = args.negative != nullptr && *args.negative == 0;
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

// ---- Blending in accumulators ----

struct AccumulateArgs {
  const uint64_t* spans = nullptr;
  uint64_t count = 0;
  uint32_t first_triangle = 0;  // as in SpanArgs
  const uint32_t* values = nullptr;
  const int64_t* terms = nullptr;
  FlatShading shading;  // to shade the target if there are neither values nor terms
  Ranks ranks;
  Accumulators to;
};

// The terms of triangle t. Template parameters as for ValuesOf.
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
