// Converts sorted fragment groups (fragment_group.h) to buckets and their fragments. No host-only includes.
#pragma once

#include "cuda/primitives/decoupled_look_back.cuh"
#include "cuda/primitives/warp_reduce.cuh"
#include "cuda/run/fragment_group.h"
#include "cuda/traversal/row_traversal.cuh"

namespace voxelpipe::cuda {

inline constexpr int kUnpackBlocks = 4;  // resident blocks per multiprocessor
// Capacity in fragments of a warp's staging buffer, filled before the output position is known.
inline constexpr uint32_t kUnpackedOfWarp = 1344;
// Units that pack a number of voxels and a number of fragments into one word: within a block, and globally.
inline constexpr uint32_t kVoxelUnit = 1 << 16;
inline constexpr uint64_t kWideVoxelUnit = uint64_t{1} << 31;
static_assert(kBundlesOfChunk * (1 + BundleCode::kMaxFollowers) < kVoxelUnit && kMaxBundledFragments < kWideVoxelUnit);

// The groups of a thread. Those of a warp are contiguous, in rows of 32 with one per lane.
struct BundlesOfThread {
  static constexpr uint32_t kOfWarp = 32 * kBundlesOfThread;

  uint32_t key[kBundlesOfThread], code[kBundlesOfThread];
  uint32_t before[kBundlesOfThread];  // packed counts of voxels and fragments before the group, within the warp
  uint32_t all = 0;                   // of the warp
  uint32_t heads = 0;                 // bit mask: groups that start a new voxel
  uint32_t here = 0;                  // number of valid groups

  // For the warp whose first group is `first`.
  __device__ BundlesOfThread(const BundleArgs& args, uint64_t first) {
    const unsigned lane = threadIdx.x % 32;
    const uint32_t of_warp = first < args.bundles ? uint32_t(min(args.bundles - first, uint64_t{kOfWarp})) : 0;
    here = (of_warp + 31 - lane) / 32;
#pragma unroll
    for (int i = 0; i < kBundlesOfThread; ++i) {
      const uint64_t b = first + lane + uint64_t(32 * i);
      key[i] = has(i) ? args.keys[b] : 0;
      code[i] = has(i) ? args.codes[b] : 0;
    }
    uint32_t last =
        first > 0 && of_warp > 0 ? args.keys[first - 1] : ~key[0];  // before the group; the first lane's alone counts
#pragma unroll
    for (int i = 0; i < kBundlesOfThread; ++i) {
      const uint32_t below = __shfl_up_sync(~0u, key[i], 1);
      const bool head = has(i) && key[i] != (lane == 0 ? last : below);
      last = __shfl_sync(~0u, key[i], 31);
      heads |= head ? 1u << i : 0;
      const uint32_t fragments = has(i) ? 1 + uint32_t(__popc(args.code.Followers(code[i]))) : 0;
      uint32_t of_group;
      before[i] = all + WarpExclusiveSum(fragments + (head ? kVoxelUnit : 0), of_group);
      all += of_group;
    }
  }
  __device__ bool has(int i) const {
    return uint32_t(i) < here;
  }
  __device__ uint32_t first_fragment(int i) const {
    return before[i] % kVoxelUnit;
  }
  // First fragment of row i + 1; uniform. All lanes call it.
  __device__ uint32_t next_group(int i) const {
    return i + 1 < kBundlesOfThread ? __shfl_sync(~0u, first_fragment(i + 1), 0) : all % kVoxelUnit;
  }
  // Writes the triangles of the fragments in group i.
  __device__ void Unpack(const BundleCode& how, int i, uint32_t* to) const {
    if (!has(i)) return;
    const uint32_t id = how.Triangle(code[i]);
    *to++ = id;
    for (uint32_t left = how.Followers(code[i]); left != 0; left &= left - 1) *to++ = id + uint32_t(__ffs(int(left)));
  }
};

__device__ inline void CopyFragments(const uint32_t* from, uint32_t count, uint32_t* to) {
  for (uint32_t k = threadIdx.x % 32; k < count; k += 32) to[k] = from[k];
}

// Writes voxels, offsets and triangles of fragments, all in order, followed by the number of all fragments.
__global__ void __launch_bounds__(kBundleThreads, kUnpackBlocks)
    UnpackBundles(const __grid_constant__ BundleArgs args) {
  constexpr unsigned kWarps = kBundleThreads / 32;
  __shared__ uint32_t rooms[kWarps][kUnpackedOfWarp];
  __shared__ uint32_t of_warps[kWarps];
  __shared__ uint64_t before_block;
  const uint64_t words = (args.fragments + 31) / 32, threads = uint64_t(gridDim.x) * kBundleThreads;
  for (int t = 0; t < args.ones_count; ++t) {
    for (uint64_t w = uint64_t(blockIdx.x) * kBundleThreads + threadIdx.x; w < words; w += threads) {
      args.ones[t][w] = WordOfOnes(args.fragments, w);
    }
  }
  const unsigned warp = threadIdx.x / 32;
  const BundlesOfThread of(args, uint64_t(blockIdx.x) * kBundlesOfChunk + warp * BundlesOfThread::kOfWarp);
  if (threadIdx.x % 32 == 0) of_warps[warp] = of.all;
  __syncthreads();
  uint32_t all;
  const uint32_t before = SumOfWarps(of_warps, all);
  const uint64_t of_block = all / kVoxelUnit * kWideVoxelUnit + all % kVoxelUnit;
  if (warp == 0) SayHere(args.first, of_block);
  uint32_t* const room = rooms[warp];
  const uint32_t fragments = of.all % kVoxelUnit;
  const bool fits = fragments <= kUnpackedOfWarp;
  if (fits) {
#pragma unroll
    for (int i = 0; i < kBundlesOfThread; ++i) of.Unpack(args.code, i, room + of.first_fragment(i));
  }
  if (warp == 0) {
    const uint64_t sum = LookBack(args.first, of_block);
    if (threadIdx.x == 0) before_block = sum;
  }
  __syncthreads();
  const uint64_t first_fragment = before_block % kWideVoxelUnit + before % kVoxelUnit;
  const uint64_t first_voxel = before_block / kWideVoxelUnit + before / kVoxelUnit;
  if (fits) CopyFragments(room, fragments, args.triangles + first_fragment);
#pragma unroll
  for (int i = 0; i < kBundlesOfThread; ++i) {
    if ((of.heads >> i & 1) == 0) continue;
    const uint64_t v = first_voxel + of.before[i] / kVoxelUnit;
    args.offsets[v] = first_fragment + of.first_fragment(i);
    args.voxels[v] = args.first_voxel + of.key[i];
  }
  if (!fits) {
    static_assert(32 * (1 + BundleCode::kMaxFollowers) <= kUnpackedOfWarp);
    uint32_t group = 0;
#pragma unroll
    for (int i = 0; i < kBundlesOfThread; ++i) {
      __syncwarp();
      of.Unpack(args.code, i, room + (of.first_fragment(i) - group));
      __syncwarp();
      const uint32_t next = of.next_group(i);
      CopyFragments(room, next - group, args.triangles + first_fragment + group);
      group = next;
    }
  }
  if (blockIdx.x + 1 < gridDim.x || threadIdx.x > 0) return;
  const uint64_t voxels = before_block / kWideVoxelUnit + all / kVoxelUnit;
  args.offsets[voxels] = args.fragments;
  *args.listed = voxels;
}

}  // namespace voxelpipe::cuda
