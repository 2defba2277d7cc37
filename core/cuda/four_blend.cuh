// Largest values of four components of floats, blended in a dense target, and the coverage: of small triangles, whose voxels a warp brings together
// first. No host-only includes.
#pragma once

#include "cuda/in_place.cuh"
#include "cuda/row_box.cuh"

namespace voxelpipe::cuda {

struct FourArgs {
  InPlaceArgs blend;         // keys, never plain
  uint32_t* bits = nullptr;  // bit grid: the coverage
  uint32_t ny = 1;
};

// The voxels that a warp's triangles touch, and by which lanes each is touched, in shared memory: neighbours in a mesh touch the same voxels, and then
// only the largest of their values goes to the target.
struct LaneBox {
  static constexpr uint32_t kVoxels = 256;
  alignas(16) uint32_t lanes[kVoxels];  // x + size[0] * (y + size[1] * z)
  uint2 touched[32];                    // voxels of the slab, and their lanes
};

// Blends voxel (x, y, z) of the slab and covers it.
__device__ inline void BlendFour(const FourArgs& args, uint32_t x, uint32_t y, uint32_t z, const uint4& keys) {
  const uint32_t key[4] = {keys.x, keys.y, keys.z, keys.w}, row = z * args.ny + y;
  ReduceOr(args.bits + (row * args.blend.words_per_row + x / 32), 1u << x % 32);
  BlendAt<4>(args.blend, uint64_t{row} * args.blend.nx + x, key, 1);
}

// Octants that reach too far for a LaneBox, one by one. Apart from its caller: few warps need it.
__device__ __noinline__ inline void BlendOctantsApart(const FourArgs& args, const uint32_t (&first)[3],
                                                      uint32_t octants, const uint4& keys) {
  for (uint32_t i = 0; i < 8; ++i) {
    if ((octants >> i & 1) != 0) {
      BlendFour(args, first[0] + (i & 1), first[1] + (i >> 1 & 1), first[2] + (i >> 2), keys);
    }
  }
}

// Where a lane's voxel x stands at `in_row` of a row of `size`, and lanes beside it have its neighbours, of which `all` are touched: those from this one on
// that lie in one word of coverage; 0 where an earlier lane has them. All of a row's lanes call it.
__device__ inline uint32_t CoveredTogether(uint32_t all, uint32_t in_row, uint32_t size, uint32_t x) {
  const uint32_t lane = threadIdx.x % 32, before = min(min(in_row, x % 32), lane);
  const uint32_t after = min(min(size - 1 - in_row, 31 - x % 32), 31 - lane);
  if ((all >> (lane - before) & ((1u << before) - 1)) != 0) return 0;
  return all >> lane & ((2u << after) - 1);
}

// The largest of one component, which `keys` begins with, of those lanes' keys that `lanes` names, at least one. Two are taken at a time, from both ends.
__device__ inline uint32_t LargestOf(const uint32_t* keys, uint32_t lanes) {
  const auto of = [keys](uint32_t lane) {
    return *reinterpret_cast<const uint32_t*>(reinterpret_cast<const char*>(keys) + lane * sizeof(uint4));
  };
  uint32_t largest = 0;
  do {
    const uint32_t first = uint32_t(__ffs(int(lanes))) - 1, last = 31 - uint32_t(__clz(int(lanes)));
    largest = max(largest, max(of(first), of(last)));
    lanes &= (lanes - 1) & ~(1u << last);
  } while (lanes != 0);
  return largest;
}

// Blends octants about corners that a warp's lanes bring, within the grid, their first voxels counted from the slab's first layer; keys[lane] are a
// lane's, in shared memory. All lanes call it.
__device__ inline void BlendOctantsOfFours(const FourArgs& args, LaneBox& box, const uint4 (&keys)[32],
                                           const uint32_t (&first)[3], uint32_t octants) {
  constexpr uint32_t kMost = LaneBox::kVoxels, kFar[3] = {0xaa, 0xcc, 0xf0};
  const unsigned lane = threadIdx.x % 32;
  uint32_t last[3], least[3], size[3];
#pragma unroll
  for (int a = 0; a < 3; ++a) last[a] = first[a] + ((octants & kFar[a]) != 0 ? 1 : 0);
  WarpBox(octants != 0, first, last, least, size);
  const uint32_t row = size[0], layer = size[0] * size[1], count = layer * size[2];
  if (max(size[0], max(size[1], size[2])) > kMost || count > kMost) {
    return BlendOctantsApart(args, first, octants, keys[lane]);
  }
  __syncwarp();  // the box is free
  for (uint32_t i = lane; i * 4 < count; i += 32) reinterpret_cast<uint4*>(box.lanes)[i] = uint4{0, 0, 0, 0};
  __syncwarp();
  if (octants != 0) {
    uint32_t* const at =
        box.lanes + (first[0] - least[0] + (first[1] - least[1]) * row + (first[2] - least[2]) * layer);
#pragma unroll
    for (uint32_t i = 0; i < 8; ++i) {
      if ((octants >> i & 1) == 0) continue;
      atomicOr(at + ((i & 1) + ((i & 2) != 0 ? row : 0) + ((i & 4) != 0 ? layer : 0)), 1u << lane);
    }
  }
  __syncwarp();
  const float of_row = 1.0f / float(row), of_layer = 1.0f / float(layer);
  for (uint32_t begin = 0; begin < count; begin += 32) {
    const uint32_t cell = begin + lane, lanes = cell < count ? box.lanes[cell] : 0;
    const uint32_t all = __ballot_sync(~0u, lanes != 0);
    if (lanes != 0) {
      const uint32_t z = DivideSmall(cell, of_layer), in_layer = cell - z * layer, y = DivideSmall(in_layer, of_row);
      const uint32_t in_row = in_layer - y * row, x = least[0] + in_row;
      const uint32_t row_of_grid = (least[2] + z) * args.ny + (least[1] + y);
      const uint32_t covered = CoveredTogether(all, in_row, row, x);
      if (covered != 0) {
        ReduceOr(args.bits + (row_of_grid * args.blend.words_per_row + x / 32), covered << x % 32);
      }
      box.touched[__popc(all & ((1u << lane) - 1))] = {row_of_grid * args.blend.nx + x, lanes};
    }
    __syncwarp();
    // Four lanes blend those of a voxel together, for they lie in one sector of memory, and the cache does one atomic operation on a sector at a time.
    const uint32_t touched = uint32_t(__popc(all)), *const component = &keys[0].x + lane % 4;
    for (uint32_t i = lane / 4; i < touched; i += 8) {
      const uint2 of = box.touched[i];
      ReduceMax(args.blend.out + (uint64_t{of.x} * 4 + lane % 4), LargestOf(component, of.y));
    }
    __syncwarp();
  }
}

// The voxels of a box of 4x4x4, x + 4y + 16z, from voxel `first` of the slab on.
__device__ inline void BlendBlockOfFours(const FourArgs& args, const uint32_t (&first)[3], uint64_t mask,
                                         const uint4& keys) {
  for (; mask != 0; mask &= mask - 1) {
    const auto n = uint32_t(__ffsll(static_cast<long long>(mask))) - 1;
    BlendFour(args, first[0] + n % 4, first[1] + n / 4 % 4, first[2] + n / 16, keys);
  }
}

}  // namespace voxelpipe::cuda
