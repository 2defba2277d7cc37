// Kernels of vertex shading (one thread per vertex) and of measuring the shaded mesh (one thread per triangle). No
// host-only includes.
#pragma once

#include "cuda/vertex/vertex_args.h"
#include "mesh/views/mesh_view.h"
#include "raster/weighed_triangle.h"
#include "shaders/shader_list.h"

namespace voxelpipe::cuda {

inline constexpr int kVertexThreads = 256, kMeasureThreads = 256;
inline constexpr int kMaxMeasureBlocks = 512;

template <int kShader>
__global__ void __launch_bounds__(kVertexThreads) ShadeVertices(const __grid_constant__ VertexArgs args) {
  const uint64_t v = uint64_t(blockIdx.x) * kVertexThreads + threadIdx.x;
  if (v >= args.count) return;
  VertexInput in;
  if (args.posed == nullptr) {
    in.flat.position = args.positions[v];
    if (args.normals != nullptr) in.flat.normal = args.normals[v];
    if (args.tangents != nullptr) in.flat.tangent = args.tangents[v];
  } else {
    uint32_t lo = 0, hi = args.part_count;
    while (hi - lo > 1) {
      const uint32_t mid = lo + (hi - lo) / 2;
      if (args.first_vertex[mid] <= v) {
        lo = mid;
      } else {
        hi = mid;
      }
    }
    in.posed = args.posed + lo;
    in.vertex = v - args.first_vertex[lo];
  }
  ShadedVertex out = ShadeVertex(VertexShaderId(kShader), in, args.params);
  if (args.motions != nullptr) AddMotion(args.motions, args.motion_count, v, out);
  if (args.shaded_positions != nullptr) args.shaded_positions[v] = out.position;
  if (args.shaded_normals != nullptr) args.shaded_normals[v] = out.normal;
  if (args.shaded_tangents != nullptr) args.shaded_tangents[v] = out.tangent;
  if (args.velocities != nullptr) {
    args.velocities[v] = {float(out.velocity.x), float(out.velocity.y), float(out.velocity.z)};
  }
}

// Partial results of MeshExtent: the bounding box of the vertices that triangles use, and SurfaceSums.
struct Surface {
  // Layout of `number`: three numbers each, except the last four: the signed volume relative to the mesh's first used
  // vertex; the weighted number of triangles; the number of triangles with a non-finite vertex, and of those outside of
  // the window.
  static constexpr int kMin = 0, kMax = 3, kArea = 6, kDominant = 9, kWidth = 12, kNormal = 15, kVolume = 18,
                       kTriangles = 19, kBad = 20, kOutside = 21, kNumbers = 22;
  double number[kNumbers];
};

__device__ inline double Joined(int number, double a, double b) {
  return number < Surface::kMax ? Min(a, b) : number < Surface::kArea ? Max(a, b) : a + b;
}

__device__ inline Surface NoSurface() {
  Surface s{};
  for (int i = 0; i < 3; ++i) {
    s.number[Surface::kMin + i] = 1.7976931348623157e308;
    s.number[Surface::kMax + i] = -1.7976931348623157e308;
  }
  return s;
}

// Reduces the partial results of a block's threads in a fixed order and writes the result. All threads call it;
// kThreads must be a multiple of 32.
template <int kThreads>
__device__ inline void WriteJoined(Surface& s, Surface* to) {
  __shared__ double of_warps[Surface::kNumbers][kThreads / 32];
  const int lane = int(threadIdx.x % 32), warp = int(threadIdx.x / 32);
#pragma unroll
  for (int i = 0; i < Surface::kNumbers; ++i) {
    double n = s.number[i];
    for (int step = 16; step > 0; step /= 2) n = Joined(i, n, __shfl_down_sync(~0u, n, step));
    if (lane == 0) of_warps[i][warp] = n;
  }
  __syncthreads();
  if (threadIdx.x >= Surface::kNumbers) return;
  const auto i = int(threadIdx.x);
  double n = of_warps[i][0];
  for (int w = 1; w < kThreads / 32; ++w) n = Joined(i, n, of_warps[i][w]);
  to->number[i] = n;
}

struct MeasureArgs {
  const Vec3d* positions = nullptr;
  const uint32_t* triangles = nullptr;  // three indices per triangle
  uint64_t count = 0;
  GridWindow window;
  Surface* of_blocks = nullptr;
};

enum class Sums { kNone, kWhole, kInWindow };

template <Sums kSums>
__global__ void __launch_bounds__(kMeasureThreads) MeasureTriangles(const MeasureArgs args) {
  Surface s = NoSurface();
  const Vec3d reference = args.positions[args.triangles[0]];
  GridWindow window = args.window;
  if (kSums != Sums::kInWindow) window.dims = {};  // a compile-time constant, so that the compiler removes the clipping
  const TriangleScale scale(window);
  const uint64_t step = uint64_t(gridDim.x) * kMeasureThreads;
  for (uint64_t t = uint64_t(blockIdx.x) * kMeasureThreads + threadIdx.x; t < args.count; t += step) {
    const uint32_t* const v = args.triangles + 3 * t;
    const Vec3d a = args.positions[v[0]], b = args.positions[v[1]], c = args.positions[v[2]];
    bool finite = true;
    Vec3d min, max;
#pragma unroll
    for (int i = 0; i < 3; ++i) {
      finite = finite && a[i] - a[i] == 0 && b[i] - b[i] == 0 && c[i] - c[i] == 0;
      min[i] = Min(a[i], Min(b[i], c[i]));
      max[i] = Max(a[i], Max(b[i], c[i]));
      s.number[Surface::kMin + i] = Min(s.number[Surface::kMin + i], min[i]);
      s.number[Surface::kMax + i] = Max(s.number[Surface::kMax + i], max[i]);
    }
    if (!finite) s.number[Surface::kBad] += 1;
    if (args.window.Misses(min, max)) s.number[Surface::kOutside] += 1;
    if constexpr (kSums != Sums::kNone) {
      const WeighedTriangle part = scale.Weigh(a, b, c);
      const Vec3d n = Cross(b - a, c - a);
      const Vec3d& area = part.size.area;
#pragma unroll
      for (int i = 0; i < 3; ++i) {
        s.number[Surface::kArea + i] += area[i];
        s.number[Surface::kDominant + i] += i == part.axis ? area[i] : 0.0;
        s.number[Surface::kWidth + i] += part.size.width[i];
        s.number[Surface::kNormal + i] += n[i];
      }
      s.number[Surface::kTriangles] += part.weight;
      s.number[Surface::kVolume] += Dot(a - reference, n) / 6;
    }
  }
  WriteJoined<kMeasureThreads>(s, args.of_blocks + blockIdx.x);
}

// One block: reduces the results of all blocks.
__global__ void __launch_bounds__(kMaxMeasureBlocks) JoinSurfaces(const Surface* of_blocks, int blocks, Surface* to) {
  Surface s = int(threadIdx.x) < blocks ? of_blocks[threadIdx.x] : NoSurface();
  WriteJoined<kMaxMeasureBlocks>(s, to);
}

}  // namespace voxelpipe::cuda
