// Positions of triangles' corners that come to shared memory a round before they are needed: for that the numbers of corners come two rounds before. In a
// kernel that works long at each triangle and has room for them. No host-only includes.
#pragma once

#include "cuda/fetch_corners.cuh"

namespace voxelpipe::cuda {

// The corners of a triangle in world space.
struct WorldCorners {
  Vec3d at[3];
};
__device__ inline FixedCorners FixedOf(const BitArgs& args, const WorldCorners& corners) {
  FixedCorners v;
  for (int i = 0; i < 3; ++i) {
    for (int a = 0; a < 3; ++a) v.at[i][a] = ToFixed(corners.at[i][a], args.fixed.scale[a], args.fixed.offset[a]);
  }
  return v;
}

// Each lane's, of a warp, on their way: the positions of its next triangle's corners, and the numbers of those and of the triangle's after that.
struct PositionsAhead {
  double of[32][9];
};
struct CornersAhead {
  uint32_t of[2][32][3];
};

// What a block of kThreads asks for a round ahead, of its triangles from `chunk` on, numbered from there, of which it has `here`; each thread those that
// are kThreads apart.
template <int kThreads>
struct WalkAhead {
  const BitArgs& walk;
  PositionsAhead& positions;  // of the warp
  CornersAhead& corners;
  uint64_t chunk;
  uint32_t here;

  // Before the first Take.
  __device__ void Begin() const {
    AskCorners(threadIdx.x);
    AwaitCopies();
    AskPositions(threadIdx.x);
    AskCorners(threadIdx.x + kThreads);
  }
  // The corners of triangle `local`, of no meaning where there is none, and asks for others.
  __device__ WorldCorners Take(uint32_t local) const {
    AwaitCopies();
    const double(&p)[9] = positions.of[threadIdx.x % 32];
    const WorldCorners taken = {{{p[0], p[1], p[2]}, {p[3], p[4], p[5]}, {p[6], p[7], p[8]}}};
    AskPositions(local + kThreads);
    AskCorners(local + 2 * kThreads);
    return taken;
  }

 private:
  __device__ uint32_t (&CornersOf(uint32_t local) const)[3] {
    return corners.of[local / kThreads % 2][threadIdx.x % 32];
  }
  __device__ void AskCorners(uint32_t local) const {
    if (local >= here) return;
    const uint32_t* const from = walk.triangles + 3 * (chunk + local);
    uint32_t(&to)[3] = CornersOf(local);
    for (int c = 0; c < 3; ++c) CopyLater(to + c, from + c);
  }
  __device__ void AskPositions(uint32_t local) const {
    if (local >= here) return;
    const uint32_t(&v)[3] = CornersOf(local);
    double(&to)[9] = positions.of[threadIdx.x % 32];
    for (int c = 0; c < 3; ++c) {
      const double* const from = &walk.positions[v[c]].x;
      for (int a = 0; a < 3; ++a) CopyLater(to + (3 * c + a), from + a);
    }
  }
};

}  // namespace voxelpipe::cuda
