// Positions of triangles' corners that come to shared memory a round before they are needed: for that the numbers of
// corners come two rounds before. In a kernel that works long at each triangle and has room for them. No host-only
// includes.
#pragma once

#include "cuda/traversal/corner_fetch.cuh"

namespace voxelpipe::cuda {

// The corners of a triangle in world space.
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

// Each lane's, of a warp, on their way: the positions of its next triangle's corners, and the numbers of those and of
// the triangle's after that.
struct PositionsAhead {
  double of[9][32];
};
struct CornersAhead {
  uint32_t of[32][3];
};

// What a lane asks for a round ahead, of triangles kStep apart; of those alone that come before `end`, which is below
// 2^32 by twice as much.
template <uint32_t kStep>
struct WalkAhead {
  const BitArgs& walk;
  PositionsAhead& positions;
  CornersAhead& corners;
  uint32_t end;

  // Before the first Take, which takes triangle t.
  __device__ void Begin(uint32_t t) const {
    AskCorners(t);
    AwaitCopies();
    AskPositions(t);
    AskCorners(t + kStep);
  }
  // The corners of triangle t, of no meaning where there is none, and asks for others.
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
  // The numbers of a triangle's corners, when those that stand there have been read.
  __device__ void AskCorners(uint32_t t) const {
    if (t >= end) return;
    const uint32_t* const from = walk.triangles + 3 * uint64_t{t};
    for (int c = 0; c < 3; ++c) CopyLater(corners.of[threadIdx.x % 32] + c, from + c);
  }
  // The positions of the corners whose numbers stand there.
  __device__ void AskPositions(uint32_t t) const {
    if (t >= end) return;
    const uint32_t(&numbers)[3] = corners.of[threadIdx.x % 32];
    // All before anything is asked for: in between it takes longer.
    const uint32_t v[3] = {numbers[0], numbers[1], numbers[2]};
    for (int c = 0; c < 3; ++c) {
      const double* const from = &walk.positions[v[c]].x;
      for (int a = 0; a < 3; ++a) CopyLater(&positions.of[3 * c + a][threadIdx.x % 32], from + a);
    }
  }
};

}  // namespace voxelpipe::cuda
