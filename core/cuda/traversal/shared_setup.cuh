// Triangle setup from world space into shared memory: by one lane per triangle, or by four if there are few triangles.
//
// A setup is about 1,300 dependent instructions, most of them for one vertex or one edge. With few triangles its
// latency dominates, and other lanes of the warp would be idle. No host-only includes.
#pragma once

#include "cuda/traversal/raster_args.cuh"

namespace voxelpipe::cuda {

inline constexpr uint32_t kNoTriangle = ~0u;

// Sets up triangle t. Returns the number of its rows in the slab.
__device__ __noinline__ inline uint64_t SetUpRows(const BitArgs& args, uint32_t t, SharedSetup& shared) {
  const PlacedCorners p = PlaceCorners(args, t);
  return SetUpShared(p.at, args.coverage, args.grid.SlabRange(), t, shared);
}

// Sets up a triangle, if `has`, by four adjacent lanes; the first three pass its corners in index space (`mine`).
// Returns the number of its rows in the slab, or 0, to each of them, after all have written. All threads of a warp call
// it.
__device__ inline uint64_t SetUpPlacedInParts(const BitArgs& args, bool has, uint32_t t, const Vec3d& mine,
                                              SharedSetup& shared) {
  Vec3d corners[3];
  for (int i = 0; i < 3; ++i) {
    for (int a = 0; a < 3; ++a) corners[i][a] = __shfl_sync(~0u, mine[a], i, kBoundsParts);
  }
  uint64_t rows = 0;
  if (has) rows = SetUpSharedInParts(corners, args.coverage, args.grid.SlabRange(), t, shared);
  __syncwarp();
  return rows;
}
// The same for triangle t (kNoTriangle: none); the first three lanes pass a vertex index each.
__device__ __noinline__ inline uint64_t SetUpCornersInParts(const BitArgs& args, uint32_t t, uint32_t vertex,
                                                            SharedSetup& shared) {
  Vec3d mine{};
  if (t != kNoTriangle && threadIdx.x % kBoundsParts < 3) mine = PlaceVertex(args, vertex);
  __syncwarp();
  return SetUpPlacedInParts(args, t != kNoTriangle, t, mine, shared);
}
// The lane's vertex index of triangle t; or 0.
__device__ inline uint32_t CornerInParts(const BitArgs& args, uint32_t t) {
  const uint32_t part = threadIdx.x % kBoundsParts;
  return t != kNoTriangle && part < 3 ? args.triangles[3 * uint64_t{t} + part] : 0;
}
__device__ inline uint64_t SetUpRowsInParts(const BitArgs& args, uint32_t t, SharedSetup& shared) {
  return SetUpCornersInParts(args, t, CornerInParts(args, t), shared);
}

inline constexpr uint32_t kMaxInParts = 32 / kBoundsParts;  // per warp at a time

// Moves results from the four lanes of each triangle to the lane with the triangle's index. All threads of a warp call
// it.
__device__ inline uint64_t RowsOfLane(uint64_t rows) {
  const uint32_t lane = threadIdx.x % 32;
  const uint64_t there = __shfl_sync(~0u, rows, int(lane * kBoundsParts % 32));
  return lane < kMaxInParts ? there : 0;
}

// Sets up the triangles number(0) to number(count - 1) (kNoTriangle: none) of a warp in `shared`, at most kMaxInParts.
// Returns the number of rows of triangle i to lane i. All threads of the warp call it.
template <typename Number>
__device__ inline uint64_t SetUpFew(const BitArgs& args, uint32_t count, Number&& number, SharedSetup* shared) {
  const uint32_t lane = threadIdx.x % 32, place = lane / kBoundsParts;
  const uint32_t t = place < count ? number(place) : kNoTriangle;
  const uint64_t rows = SetUpRowsInParts(args, t, shared[place < count ? place : 0]);
  const uint64_t there = RowsOfLane(rows);
  return lane < count ? there : 0;
}
// The same for up to 32 triangles.
template <typename Number>
__device__ inline uint64_t SetUpRowsOfWarp(const BitArgs& args, uint32_t count, Number&& number, SharedSetup* shared) {
  if (count <= kMaxInParts) return SetUpFew(args, count, number, shared);
  const uint32_t lane = threadIdx.x % 32, t = lane < count ? number(lane) : kNoTriangle;
  const uint64_t rows = t != kNoTriangle ? SetUpRows(args, t, shared[lane]) : 0;
  __syncwarp();
  return rows;
}

// Number of layers of a triangle that has rows.
__device__ inline uint32_t LayersOf(const SharedSetup& s) {
  return uint32_t(s.end[2] - s.begin[2]);
}

}  // namespace voxelpipe::cuda
