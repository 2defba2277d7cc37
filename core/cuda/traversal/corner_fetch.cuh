// Loads vertex indices of triangles with prefetching, and vertices in fixed point.
//
// A thread requests the vertex indices of its next triangle while it processes the current one, by an asynchronous copy
// to shared memory. A load to a register would stall at once if registers are short, because the register has to be
// spilled. No host-only includes.
#pragma once

#include "cuda/traversal/raster_args.cuh"

namespace voxelpipe::cuda {

struct FixedCorners {
  int at[3][3];
};

// The first data loaded of a triangle: its vertex indices. Packed corners would take too much space, so StageCorners
// only prefetches them to the cache.
template <bool kPacked>
struct Fetched {
  Corners corners;
};
template <>
struct Fetched<true> {
  uint32_t triangle;
};
// The id of the triangle with a number in the order of traversal: packed corners may have one of their own.
template <bool kPacked>
__device__ inline uint32_t IdOf(const BitArgs& args, uint32_t number) {
  if constexpr (kPacked) return args.packed[3 * uint64_t{number}].triangle;
  return number;
}

template <bool kPacked>
__device__ inline Fetched<kPacked> FetchNow(const BitArgs& args, uint32_t t) {
  if constexpr (kPacked) {
    return {t};
  } else {
    return {LoadCorners(args.triangles, t)};
  }
}

// Vertex indices in flight for a warp, in shared memory; each lane has its own.
struct StagedCorners {
  uint32_t v[3 * 32];
};

// Asynchronous copy of 4 or 8 bytes to shared memory; complete when AwaitCopies returns.
template <typename T>
__device__ inline void CopyLater(T* to, const T* from) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
  asm volatile("cp.async.ca.shared.global [%0], [%1], %2;" ::"r"(uint32_t(__cvta_generic_to_shared(to))), "l"(from),
               "n"(sizeof(T))
               : "memory");
#else
  *to = *from;
#endif
}
__device__ inline void AwaitCopies() {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
  asm volatile("cp.async.wait_all;" ::: "memory");
#endif
}

// Prefetches a triangle's vertex indices to the L2 cache. Unused with packed corners.
__device__ inline void PrefetchCorners([[maybe_unused]] const BitArgs& args, [[maybe_unused]] uint32_t t) {
#if defined(__CUDA_ARCH__)
  asm volatile("prefetch.global.L2 [%0];" ::"l"(args.triangles + 3 * uint64_t{t}));
#endif
}

// Requests the corners of triangle t.
template <bool kPacked>
__device__ inline void StageCorners(const BitArgs& args, uint32_t t, StagedCorners& staged) {
  if constexpr (kPacked) {
#if defined(__CUDA_ARCH__)
    asm volatile("prefetch.global.L2 [%0];" ::"l"(args.packed + 3 * uint64_t{t}));
#endif
  } else {
    const uint32_t* const from = args.triangles + 3 * uint64_t{t};
    uint32_t* const to = staged.v + 3 * (threadIdx.x % 32);
    for (int c = 0; c < 3; ++c) CopyLater(to + c, from + c);
  }
}

// Takes what the last StageCorners requested, for triangle t. Undefined without a request.
template <bool kPacked>
__device__ inline Fetched<kPacked> TakeStaged(uint32_t t, const StagedCorners& staged) {
  if constexpr (kPacked) {
    return {t};
  } else {
    AwaitCopies();
    const uint32_t* const mine = staged.v + 3 * (threadIdx.x % 32);
    return {{{mine[0], mine[1], mine[2]}}};
  }
}

template <bool kPacked>
__device__ inline FixedCorners LoadFixed(const BitArgs& args, const Fetched<kPacked>& fetched) {
  FixedCorners v;
  if constexpr (kPacked) {
    const PackedPlace& place = args.packed_place;
    const PackedVertex* const from = args.packed + 3 * uint64_t{fetched.triangle};
    const PackedVertex p[3] = {from[0], from[1], from[2]};
    for (int i = 0; i < 3; ++i) {
      for (int a = 0; a < 3; ++a) {
        v.at[i][a] = PackedToFixed(p[i].at[a], place.scale[a], place.offset[a], args.fixed.wall[a]);
      }
    }
  } else {
    for (int i = 0; i < 3; ++i) {
      const Vec3d& p = args.positions[fetched.corners.v[i]];
      for (int a = 0; a < 3; ++a) {
        v.at[i][a] = ToFixed(p[a], args.fixed.scale[a], args.fixed.offset[a], args.fixed.wall[a]);
      }
    }
  }
  return v;
}
template <bool kPacked>
__device__ inline FixedCorners LoadFixed(const BitArgs& args, uint32_t t) {
  return LoadFixed(args, FetchNow<kPacked>(args, t));
}

}  // namespace voxelpipe::cuda
