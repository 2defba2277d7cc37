// Shared by the kernels that rasterize occupancy bits directly from world space (small_triangles.cuh, shared_setup.cuh,
// large_triangles.cuh, block_bins.cuh, block_raster.cuh): their arguments, writing rows of voxels, and transforming
// vertices to index space. No host-only includes.
#pragma once

#include "cuda/primitives/atomics.cuh"
#include "cuda/traversal/triangle_walk.cuh"
#include "raster/filtered/small_triangle_tests.h"

namespace voxelpipe::cuda {

inline constexpr uint32_t kMaxApart = 30;  // limited by a warp's lanes and by 48 KiB of shared memory

// The few largest triangles of a mesh, unordered, with world-space corners. `count` may exceed the number of listed
// ones.
struct LargestTriangles {
  uint32_t count;
  uint32_t triangles[kMaxApart];
  Vec3d corners[kMaxApart][3];

  __device__ uint32_t listed() const { return min(count, kMaxApart); }
};

// Pool of bricks of 32x8x8 voxels that are allocated during rasterization (bit_bricks.cuh).
struct BitPool {
  static constexpr uint32_t kWordsOfPlace = 64;
  uint32_t* places = nullptr;  // slot table of all bricks of the slab, x fastest; or null
  uint32_t* words = nullptr;   // kWordsOfPlace per slot
  uint64_t* asked = nullptr;   // counter: bricks that asked for a slot
  uint64_t quads = 0;          // 16-byte units of `places` to clear
  uint32_t dims_x = 1, dims_y = 1;

  __device__ uint32_t* WordsOf(uint64_t place) const { return words + place * kWordsOfPlace; }
  __device__ void Name(uint64_t, uint32_t) const {}
};

struct BitArgs {
  GridView grid;  // rows outside its slab are skipped
  uint32_t* bits = nullptr;
  uint64_t quads = 0;  // 16-byte units to clear
  // Leading blocks of the rasterization kernel that clear the grid and the queues; 0: earlier kernels do.
  uint32_t clear_blocks = 0;
  uint32_t* cleared = nullptr;  // number of those that are done; 0 before and after
  Coverage coverage{};
  FixedPlace fixed;
  Vec3d inverse_size;  // 1 / grid.space.voxel_size, rounded
  const uint32_t* triangles = nullptr;
  const Vec3d* positions = nullptr;      // world space
  const PackedVertex* packed = nullptr;  // corners of all triangles with their triangle ids; or null
  PackedPlace packed_place;
  // Drawn separately, and then skipped by the large queue for occupancy bits; or null.
  const LargestTriangles* largest = nullptr;
  uint64_t triangle_count = 0;
  int rounds = 1;  // triangles per thread of WalkCells and FindCells
  BitPool pool;    // bits are set here first, if `places` is not null
  // Queues, each with capacity for all triangles.
  uint32_t *layer_queue = nullptr, *large_queue = nullptr;
  uint64_t* queued = nullptr;  // length of each queue
};

// True if triangle t is drawn separately.
__device__ inline bool IsAmongLargest(const BitArgs& args, uint32_t t) {
  if (args.largest == nullptr) return false;
  bool among = false;
  for (uint32_t i = 0; i < args.largest->listed(); ++i) among = among || args.largest->triangles[i] == t;
  return among;
}

enum BitQueue : int { kLayerQueue, kLargeQueue, kBitQueues };

// Enumerates a clipped 2x2x2 mask by rows: set(word along x, y, z, mask over that word and the next one).
template <typename Set>
__device__ inline void ForEachPair(const int (&first)[3], uint32_t octants, Set&& set) {
  for (int i = 0; i < 4; ++i) {
    const uint32_t pair = octants >> 2 * i & 3;
    if (pair == 0) continue;
    // Within the grid, although the mask's first voxel may be outside.
    const int x = first[0] + ((pair & 1) != 0 ? 0 : 1);
    set(x >> 5, first[1] + (i & 1), first[2] + (i >> 1), uint64_t{(pair & 1) != 0 ? pair : 1} << (x & 31));
  }
}

// Sets the bits of `mask` in a word. `look`: reads first, which is cheaper than an atomic if most bits are set already,
// as when many triangles share a voxel.
__device__ inline void SetWord(uint32_t* word, uint32_t mask, bool look) {
  if (look && (__ldca(word) & mask) == mask) return;
  ReduceOr(word, mask);
}
__device__ inline void SetRow(uint32_t* row, int x_begin, int x_end, bool look) {
  const int first = x_begin / 32, last = (x_end - 1) / 32;
  const uint32_t from = ~0u << (x_begin % 32), upto = ~0u >> (31 - (x_end - 1) % 32);
  if (first == last) return SetWord(row + first, from & upto, look);
  SetWord(row + first, from, look);
  for (int w = first + 1; w < last; ++w) SetAllBits(row + w);
  SetWord(row + last, upto, look);
}
__device__ inline void SetRow(const BitArgs& args, int y, int z, int x_begin, int x_end) {
  SetRow(args.bits + args.grid.Word(0, y, z), x_begin, x_end, false);
}

// Not inlined, like other rare code: small kernels are limited by instruction fetch.
__device__ __noinline__ inline Vec3d DividePlainly(const Vec3d& a, const Vec3d& b) {
  return {a.x / b.x, a.y / b.y, a.z / b.z};
}

// Correctly rounded quotient in fewer operations than a division: two corrections of a product with the rounded
// reciprocal, each with an exact remainder (P. Markstein, "Computation of elementary functions on the IBM RISC
// System/6000 processor", 1990).
__device__ inline double Divide(double a, double b, double inverse) {
  double q = a * inverse;
  q = fma(fma(-q, b, a), inverse, q);
  return fma(fma(-q, b, a), inverse, q);
}
// The fast equivalent of WorldToIndex.
__device__ inline Vec3d PlacePosition(const BitArgs& args, const Vec3d& position) {
  const IndexSpace& space = args.grid.space;
  const Vec3d& size = space.voxel_size;
  const Vec3d p = position - space.origin;
  // The remainders of tiny numbers would underflow.
  const bool tiny = !(Abs(p.x) >= 0x1p-400 && Abs(p.y) >= 0x1p-400 && Abs(p.z) >= 0x1p-400);
  if (tiny) return ToWalls(space, DividePlainly(p, size));
  return ToWalls(space, {Divide(p.x, size.x, args.inverse_size.x), Divide(p.y, size.y, args.inverse_size.y),
                         Divide(p.z, size.z, args.inverse_size.z)});
}

__device__ inline Vec3d PlaceVertex(const BitArgs& args, uint32_t vertex) {
  return PlacePosition(args, args.positions[vertex]);
}

struct PlacedCorners {
  Vec3d at[3];
};
__device__ __noinline__ inline PlacedCorners PlaceCorners(const BitArgs& args, uint32_t t) {
  const Corners c = LoadCorners(args.triangles, t);
  return {{PlaceVertex(args, c.v[0]), PlaceVertex(args, c.v[1]), PlaceVertex(args, c.v[2])}};
}

// Clears the words after the last one up to a multiple of 16 bytes. Called by one block.
__device__ inline void ClearBehind(const BitArgs& args) {
  const uint64_t begin = uint64_t(args.grid.words_per_row) * uint64_t(args.grid.dims[1]) *
                             uint64_t(args.grid.slab_end - args.grid.slab_begin) +
                         threadIdx.x;
  if (begin < args.quads * 4) args.bits[begin] = 0;
}

}  // namespace voxelpipe::cuda
