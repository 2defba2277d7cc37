// Max blend of four float components in a dense target, with coverage, for small triangles: a warp combines voxels in
// shared memory first. No host-only includes.
#pragma once

#include "cuda/coverage/atomic_blend.cuh"
#include "cuda/traversal/warp_bit_tile.cuh"

namespace voxelpipe::cuda {

struct FourArgs {
  InPlaceArgs blend;         // with order-preserving keys, never plain floats
  uint32_t* bits = nullptr;  // bit grid: coverage
  uint32_t ny = 1;
  uint32_t flip = 0;  // FlipOf(blend)
  // A 2x2x2 mask whose first voxel is below these limits lies within the slab.
  uint32_t inner[3] = {};
  bool all_within = false;  // true if all voxels of the mesh lie within the slab
};

// Per-warp tile in shared memory: the voxels touched by a warp's triangles, with a mask of the lanes that touch each.
// Neighbours in a mesh touch the same voxels, and only the maximum is blended into the target.
struct LaneBox {
  static constexpr uint32_t kVoxels = 256;
  // Index x + size[0] * (y + size[1] * z); zero between uses. One more word per lane behind them is a dummy destination
  // for untouched voxels.
  alignas(16) uint32_t lanes[kVoxels + 32];
  uint4 largest[32];  // combined keys per touched voxel
  uint32_t at[32];    // and its index in the slab
  static_assert(kVoxels <= 1 << 8);
  uint8_t voxels[kVoxels];  // list of touched voxels

  // Clears the tile before its first use. All lanes call it, then __syncwarp.
  __device__ void Clear() {
    for (uint32_t i = threadIdx.x % 32; i * 4 < kVoxels; i += 32)
      reinterpret_cast<uint4*>(lanes)[i] = uint4{0, 0, 0, 0};
  }
};

// Blends voxel (x, y, z) of the slab and sets its coverage.
__device__ inline void BlendFour(const FourArgs& args, uint32_t x, uint32_t y, uint32_t z, const uint4& keys) {
  const uint32_t key[4] = {keys.x, keys.y, keys.z, keys.w}, row = z * args.ny + y;
  ReduceOr(args.bits + (row * args.blend.words_per_row + x / 32), 1u << x % 32);
  BlendAt<4>(args.blend, uint64_t{row} * args.blend.nx + x, key, 1);
}

// Blends 2x2x2 masks that do not fit in a tile voxel by voxel. Not inlined: rare.
__device__ __noinline__ inline void BlendOctantsApart(const FourArgs& args, uint32_t x, uint32_t y, uint32_t z,
                                                      uint32_t octants, uint4 keys) {
  for (uint32_t i = 0; i < 8; ++i) {
    if ((octants >> i & 1) != 0) BlendFour(args, x + (i & 1), y + (i >> 1 & 1), z + (i >> 2), keys);
  }
}

// Fixed-point reciprocal of n <= 256: number / n == number * InverseOf(n) >> 20 for numbers below 256.
__device__ inline uint32_t InverseOf(uint32_t n) {
  return uint32_t(fmaf(Reciprocal(float(n)), 0x1p20f, 1.5f));
}

// Hides a pointer's origin from the compiler, which would otherwise recompute it instead of keeping it in a register.
template <typename T>
__device__ inline T* Opaque(T* p) {
#if defined(__CUDA_ARCH__)
  asm("" : "+l"(p));
#endif
  return p;
}

// Compacts the touched voxels among `count` tile cells to the front, in order, with their lane masks. Returns their
// number. All lanes call it, with __syncwarp before and after.
__device__ inline uint32_t CollectTouched(LaneBox& box, uint32_t count, uint32_t before) {
  const uint32_t lane = threadIdx.x % 32;
  uint32_t touched = 0;
  for (uint32_t begin = 0; begin < count; begin += 32) {
    const uint32_t lanes = box.lanes[begin + lane], all = __ballot_sync(~0u, lanes != 0);
    if (lanes != 0) box.lanes[begin + lane] = 0;
    __syncwarp();
    const uint32_t to = touched + uint32_t(__popc(int(all & before)));
    if (lanes != 0) box.lanes[to] = lanes;
    if (lanes != 0) box.voxels[to] = uint8_t(begin + lane);
    touched += uint32_t(__popc(int(all)));
  }
  return touched;
}

// Component-wise maximum of the keys of the lanes in mask `lanes`; 0 if it is empty. Takes two per iteration, from both
// ends. kSameLast: the last component is uniform and not computed here.
template <bool kSameLast>
__device__ inline uint4 LargestOf(const uint4 (&keys)[32], uint32_t lanes) {
  uint4 largest = {0, 0, 0, 0};
  while (lanes != 0) {
    const uint32_t first = uint32_t(__ffs(int(lanes))) - 1, last = 31 - uint32_t(__clz(int(lanes)));
    const uint4 a = keys[first], b = keys[last];
    largest.x = max(largest.x, max(a.x, b.x));
    largest.y = max(largest.y, max(a.y, b.y));
    largest.z = max(largest.z, max(a.z, b.z));
    if constexpr (!kSameLast) largest.w = max(largest.w, max(a.w, b.w));
    lanes &= (lanes - 1) & ~(1u << last);
  }
  return largest;
}

// Blends the 2x2x2 masks of a warp's lanes, clipped to the grid; `first` and `last` voxels are relative to the slab.
// keys[lane] is in shared memory. `before` is LanesBefore(): the lane's own bit minus 1. All lanes call it.
template <bool kSameLast>
__device__ inline void BlendOctantsOfFours(const FourArgs& args, LaneBox& box, const uint4 (&keys)[32], uint32_t before,
                                           const uint32_t (&first)[3], const uint32_t (&last)[3], uint32_t octants) {
  constexpr uint32_t kMost = LaneBox::kVoxels;
  const uint32_t lane = threadIdx.x % 32;
  uint32_t least[3], size[3];
  WarpBox(octants != 0, first, last, least, size);
  const uint32_t row = size[0], layer = size[0] * size[1], count = layer * size[2];
  if (max(size[0], max(size[1], size[2])) > kMost || count > kMost) {
    return BlendOctantsApart(args, first[0], first[1], first[2], octants, keys[lane]);
  }
  // Each lane writes all eight voxels: skipping some would be slower.
  const SharedPlace lanes_of = PlaceOf(box.lanes), none = lanes_of + (kMost + lane) * 4;
  const SharedPlace at =
      lanes_of + (first[0] - least[0] + (first[1] - least[1]) * row + (first[2] - least[2]) * layer) * 4;
#pragma unroll
  for (uint32_t i = 0; i < 8; ++i) {
    const SharedPlace voxel = at + (i & 1) * 4 + ((i & 2) != 0 ? row * 4 : 0) + ((i & 4) != 0 ? layer * 4 : 0);
    SharedOr((octants >> i & 1) != 0 ? voxel : none, before + 1);
  }
  __syncwarp();
  const uint32_t touched = CollectTouched(box, count, before);
  const uint32_t of_row = InverseOf(row), of_layer = InverseOf(layer);
  __syncwarp();
  for (uint32_t begin = 0; begin < touched; begin += 32) {
    const bool has = begin + lane < touched;
    const uint32_t voxel = has ? box.voxels[begin + lane] : 0;
    const uint32_t z = voxel * of_layer >> 20, in_layer = voxel - z * layer, y = in_layer * of_row >> 20;
    const uint32_t in_row = in_layer - y * row, x = least[0] + in_row;
    const uint32_t row_of_grid = (least[2] + z) * args.ny + (least[1] + y);
    // Adjacent lanes with voxels in one word of the coverage set it together.
    const uint32_t next = __shfl_down_sync(~0u, voxel, 1);
    const bool goes_on = next == voxel + 1 && in_row + 1 < row && x % 32 != 31;
    const uint32_t on = __ballot_sync(~0u, goes_on) & 0x7fffffff, from = ~on >> lane;
    if (has && (on * 2 & (before + 1)) == 0) {
      ReduceOr(args.bits + (row_of_grid * args.blend.words_per_row + x / 32), ((from & (0 - from)) * 2 - 1) << x % 32);
    }
    if (has) box.at[lane] = row_of_grid * args.blend.nx + x;
    // Two lanes per voxel if there are enough, each with every second lane of its mask.
    const uint32_t some = min(touched - begin, 32u), shared = some <= 16 ? 1 : 0, mine = lane >> shared;
    uint32_t of_mine = mine < some ? box.lanes[begin + mine] : 0;
    if (shared != 0) of_mine &= 0x55555555u << lane % 2;
    uint4 largest = LargestOf<kSameLast>(keys, of_mine);
    if (shared != 0) {
      largest.x = max(largest.x, __shfl_xor_sync(~0u, largest.x, 1));
      largest.y = max(largest.y, __shfl_xor_sync(~0u, largest.y, 1));
      largest.z = max(largest.z, __shfl_xor_sync(~0u, largest.z, 1));
      if constexpr (!kSameLast) largest.w = max(largest.w, __shfl_xor_sync(~0u, largest.w, 1));
    }
    if constexpr (kSameLast) largest.w = keys[0].w;
    if (mine < some && (lane & shared) == 0) box.largest[mine] = largest;
    __syncwarp();
    if (has) box.lanes[begin + lane] = 0;
    // Four lanes blend the components of one voxel: they lie in one sector, and the cache serializes atomic operations
    // on a sector.
    uint32_t* const component = Opaque(args.blend.out + lane % 4);
#pragma unroll 1
    for (uint32_t i = lane / 4; i < some; i += 8) {
      ReduceMax(component + uint64_t{box.at[i]} * 4, (&box.largest[i].x)[lane % 4]);
    }
    __syncwarp();
  }
}

// Blends the voxels of a 4x4x4 block, x + 4y + 16z, from voxel `first` of the slab on.
__device__ inline void BlendBlockOfFours(const FourArgs& args, const uint32_t (&first)[3], uint64_t mask,
                                         const uint4& keys) {
  for (; mask != 0; mask &= mask - 1) {
    const auto n = uint32_t(__ffsll(static_cast<long long>(mask))) - 1;
    BlendFour(args, first[0] + n % 4, first[1] + n / 4 % 4, first[2] + n / 16, keys);
  }
}

}  // namespace voxelpipe::cuda
