// Occupancy bits in grids larger than the L2 cache with few large triangles: bins triangles by grid blocks ("pieces" in
// the code).
//
// An atomic on an uncached word reads its sector from memory, although it was just cleared. So the grid is divided into
// blocks of 8x8 rows of kPieceWords words, and each triangle is added to the bins of the grid blocks that its box
// intersects. Then a thread block rasterizes a grid block in shared memory and stores it (block_raster.cuh). Triangles
// that overflow a bin are drawn afterwards by atomics (large_triangles.cuh). No host-only includes.
#pragma once

#include "cuda/primitives/dependent_launch.cuh"
#include "cuda/traversal/setup_layers.cuh"
#include "cuda/traversal/shared_setup.cuh"

namespace voxelpipe::cuda {

inline constexpr int kBinThreads = 64;
inline constexpr int kPieceWords = 32;
inline constexpr uint32_t kBinRoom = 256;   // capacity of a bin in triangles
inline constexpr uint32_t kMaxLarge = 256;  // triangles that every grid block tests if there are no bins

// Bins of triangles; or none, and every grid block tests a few triangles, the only ones that are set up: args.largest,
// or else the first kMaxLarge of the large queue.
struct Bins {
  uint32_t dims[3] = {0, 0, 0};  // number of grid blocks
  // Range of grid blocks along z that are stored; the others do not intersect the mesh.
  uint32_t z_begin = 0, z_end = 0;
  SharedSetup* set_up = nullptr;  // setup of every triangle
  uint32_t* counts =
      nullptr;  // number of triangles per grid block, including those that overflow; padded to a multiple of 16 bytes
  uint32_t* triangles = nullptr;   // kBinRoom per grid block
  uint32_t* overflowed = nullptr;  // a bit per triangle; cleared with `counts`, which it follows
};

// The grid blocks that a triangle's box intersects.
struct PieceBox {
  uint32_t first[3], size[3];
  __device__ uint32_t count() const { return size[0] * size[1] * size[2]; }
};
__device__ inline PieceBox PiecesOf(const SharedSetup& s, int slab_begin) {
  constexpr int kEdges[3] = {kPieceWords * 32, kPieceEdge, kPieceEdge};
  PieceBox box;
  for (int a = 0; a < 3; ++a) {
    const int from = a == 2 ? slab_begin : 0;
    box.first[a] = uint32_t(s.begin[a] - from) / uint32_t(kEdges[a]);
    box.size[a] = uint32_t(s.end[a] - 1 - from) / uint32_t(kEdges[a]) + 1 - box.first[a];
  }
  return box;
}

// Adds a triangle to a bin. If the bin is full the triangle goes to the layer queue, once.
__device__ inline void AddToBin(const BitArgs& args, const Bins& bins, uint32_t piece, uint32_t t) {
  const uint32_t at = atomicAdd(bins.counts + piece, 1u);
  if (at < kBinRoom) {
    bins.triangles[uint64_t{piece} * kBinRoom + at] = t;
    return;
  }
  const uint32_t bit = 1u << (t % 32);
  if ((atomicOr(bins.overflowed + t / 32, bit) & bit) != 0) return;
  args.layer_queue[atomicAdd(reinterpret_cast<unsigned long long*>(args.queued + kLayerQueue), 1ull)] = t;
}

// False if the triangle has no row among rows y to y + 7 of layers z to z + 7. Bounds of y are sums and products of z,
// each rounded once, so they are monotonic: layers in between have bounds in between.
template <typename Real>
__device__ inline bool MayMeet(const SpanBounds<Real>& bounds, Real y, Real z) {
  const Real z_last = z + Real(kPieceEdge - 1);
  Real first = y, last = y + Real(kPieceEdge - 1);
  for (int i = 0; i < 4; ++i) {
    const Real here = bounds.y_of_z[i].s * z, there = bounds.y_of_z[i].s * z_last;
    first = Greater(first, Lesser(bounds.y_of_z[i].lo - here, bounds.y_of_z[i].lo - there));
    last = Lesser(last, Greater(bounds.y_of_z[i].hi - here, bounds.y_of_z[i].hi - there));
  }
  return first <= last;
}
__device__ inline bool MayMeet(const SharedSetup& s, int y, int z) {
  if (s.span_class == SpanClass::kNarrow) return MayMeet(s.narrow, float(y - s.cell[1]), float(z - s.cell[2]));
  if (s.span_class == SpanClass::kWide) return MayMeet(s.wide, double(y) - s.base.y, double(z) - s.base.z);
  return true;
}

// Sets up all triangles and adds them to bins, by warp `warp` of `warps`, with shared memory for 32. `kFew`: no warp
// has more than kMaxInParts triangles. Waits for earlier kernels.
template <bool kFew>
__device__ inline void FillBins(const BitArgs& args, const Bins& bins, uint64_t warp, uint64_t warps,
                                SharedSetup* shared) {
  const unsigned lane = threadIdx.x % 32;
  const uint64_t each = min(uint64_t{32}, (args.triangle_count + warps - 1) / warps);
  for (uint64_t begin = warp * each; begin < args.triangle_count; begin += warps * each) {
    const uint64_t here = min(each, args.triangle_count - begin);
    PieceBox box{};
    uint32_t pieces = 0;
    const auto triangle = [begin](uint32_t i) { return uint32_t(begin) + i; };
    uint64_t rows = 0;
    if constexpr (kFew) {
      rows = SetUpFew(args, uint32_t(here), triangle, shared);
    } else if (lane < here) {
      rows = SetUpRows(args, triangle(lane), shared[lane]);
    }
    if (rows > 0) {
      box = PiecesOf(shared[lane], int(args.grid.slab_begin));
      pieces = box.count();
    }
    uint32_t total;
    const uint32_t before = WarpExclusiveSum(pieces, total);
    __syncwarp();
    AwaitEarlier();
    static_assert(sizeof(SharedSetup) % sizeof(uint2) == 0);
    const auto* const from_here = reinterpret_cast<const uint2*>(shared);
    auto* const to_there = reinterpret_cast<uint2*>(bins.set_up + begin);
    for (uint32_t i = lane; i < uint32_t(here) * uint32_t(sizeof(SharedSetup) / sizeof(uint2)); i += 32) {
      to_there[i] = from_here[i];
    }
    for (uint32_t first = 0; first < total; first += 32) {
      const uint32_t item = first + lane;
      const int i = LaneOfItem(before, item);
      const uint32_t number = item - __shfl_sync(~0u, before, i);
      uint32_t from[3], size[2];
      for (int a = 0; a < 3; ++a) from[a] = __shfl_sync(~0u, box.first[a], i);
      for (int a = 0; a < 2; ++a) size[a] = __shfl_sync(~0u, box.size[a], i);
      if (item >= total) continue;
      const uint32_t yz = number / size[0];
      const uint32_t x = from[0] + number - yz * size[0], y = from[1] + yz % size[1], z = from[2] + yz / size[1];
      if (!MayMeet(shared[i], int(y) * kPieceEdge, int(z) * kPieceEdge + int(args.grid.slab_begin))) continue;
      AddToBin(args, bins, x + bins.dims[0] * (y + bins.dims[1] * z), uint32_t(begin) + uint32_t(i));
    }
    __syncwarp();
  }
  AwaitEarlier();  // also without triangles
}

}  // namespace voxelpipe::cuda
