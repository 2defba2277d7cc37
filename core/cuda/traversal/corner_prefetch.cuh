// Prefetches vertex positions to shared memory one iteration ahead, and vertex indices two iterations ahead. For
// kernels with much work per triangle and enough shared memory. No host-only includes.
#pragma once

#include "cuda/traversal/corner_fetch.cuh"

namespace voxelpipe::cuda {

// A triangle's corners in world space.
struct WorldCorners {
  Vec3d at[3];
};
__device__ inline FixedCorners FixedOf(const BitArgs& args, const WorldCorners& corners) {
  FixedCorners v;
  for (int i = 0; i < 3; ++i) {
    for (int a = 0; a < 3; ++a) {
      v.at[i][a] = ToFixed(corners.at[i][a], args.fixed.scale[a], args.fixed.offset[a], args.fixed.wall[a]);
    }
  }
  return v;
}

// In flight for a warp, per lane: the positions of the next triangle's vertices, and the vertex indices of the next
// triangle and of the one after it.
struct PositionsAhead {
  double of[9][32];
};
struct CornersAhead {
  uint32_t of[32][3];
};

// The software pipeline of a lane whose triangles are kStep apart. Requests only triangles below `end`, which is below
// 2^32 by at least 2 * kStep.
template <uint32_t kStep>
struct WalkAhead {
  const BitArgs& walk;
  PositionsAhead& positions;
  CornersAhead& corners;
  uint32_t end;

  // Call before the first Take, which takes triangle t.
  __device__ void Begin(uint32_t t) const {
    AskCorners(t);
    AwaitCopies();
    AskPositions(t);
    AskCorners(t + kStep);
  }
  // Returns the corners of triangle t (undefined past `end`) and requests the next ones.
  __device__ WorldCorners Take(uint32_t t) const {
    AwaitCopies();
    WorldCorners taken;
    for (int c = 0; c < 3; ++c) {
      for (int a = 0; a < 3; ++a) taken.at[c][a] = positions.of[3 * c + a][threadIdx.x % 32];
    }
    AskPositions(t + kStep);
    AskCorners(t + 2 * kStep);
    return taken;
  }

 private:
  // Requests a triangle's vertex indices, after the previous ones have been read.
  __device__ void AskCorners(uint32_t t) const {
    if (t >= end) return;
    const uint32_t* const from = walk.triangles + 3 * uint64_t{t};
    for (int c = 0; c < 3; ++c) CopyLater(corners.of[threadIdx.x % 32] + c, from + c);
  }
  // Requests the positions of the vertices whose indices have arrived.
  __device__ void AskPositions(uint32_t t) const {
    if (t >= end) return;
    const uint32_t(&numbers)[3] = corners.of[threadIdx.x % 32];
    // Reads all indices before the first request: interleaving is slower.
    const uint32_t v[3] = {numbers[0], numbers[1], numbers[2]};
    for (int c = 0; c < 3; ++c) {
      const double* const from = &walk.positions[v[c]].x;
      for (int a = 0; a < 3; ++a) CopyLater(&positions.of[3 * c + a][threadIdx.x % 32], from + a);
    }
  }
};

}  // namespace voxelpipe::cuda
