// Kernels that convert runs of equal voxels among sorted fragments to buckets. No host-only includes.
#pragma once

#include "cuda/primitives/decoupled_look_back.cuh"
#include "cuda/primitives/warp_reduce.cuh"
#include "cuda/run/bucket_views.h"
#include "cuda/traversal/row_traversal.cuh"

namespace voxelpipe::cuda {

// In-place exclusive scan by a single block; sums[count] receives the total.
inline constexpr int kScanThreads = 1024, kScannedOfThread = 8;
__global__ void __launch_bounds__(kScanThreads) ScanChunks(uint64_t* sums, uint64_t count) {
  __shared__ uint64_t of_warps[kScanThreads / 32];
  const unsigned lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  uint64_t before = 0;
  for (uint64_t begin = 0; begin < count; begin += uint64_t(kScanThreads) * kScannedOfThread) {
    const uint64_t first = begin + uint64_t(threadIdx.x) * kScannedOfThread;
    uint64_t each[kScannedOfThread], mine = 0;
#pragma unroll
    for (int i = 0; i < kScannedOfThread; ++i) {
      each[i] = first + uint64_t(i) < count ? sums[first + uint64_t(i)] : 0;
      mine += each[i];
    }
    const uint64_t here = SumUpto(mine);
    if (lane == 31) of_warps[warp] = here;
    __syncthreads();
    const uint64_t warps = SumUpto(of_warps[lane]);
    const uint64_t earlier = __shfl_sync(~0u, warps, warp == 0 ? 0 : int(warp) - 1);
    uint64_t at = before + (warp == 0 ? 0 : earlier) + (here - mine);
#pragma unroll
    for (int i = 0; i < kScannedOfThread; ++i) {
      if (first + uint64_t(i) < count) sums[first + uint64_t(i)] = at;
      at += each[i];
    }
    before += __shfl_sync(~0u, warps, 31);
    __syncthreads();
  }
  if (threadIdx.x == 0) sums[count] = before;
}

// Finds which of a thread's keys start a new voxel: bit i is set for key i.
__device__ inline uint32_t FindHeads(const SortedKeys& args, uint64_t begin, uint32_t (&key)[kKeysOfThread]) {
  if (begin >= args.fragments) return 0;
  const auto here = uint32_t(min(args.fragments - begin, uint64_t{kKeysOfThread}));
#pragma unroll
  for (int i = 0; i < kKeysOfThread; i += 4) {
    const uint32_t* const from = args.keys + begin + uint64_t(i);
    uint4 four{0, 0, 0, 0};
    if (uint32_t(i) + 4 <= here) {
      four = *reinterpret_cast<const uint4*>(from);
    } else if (uint32_t(i) < here) {
      four = {from[0], uint32_t(i) + 1 < here ? from[1] : 0, uint32_t(i) + 2 < here ? from[2] : 0, 0};
    }
    key[i] = four.x, key[i + 1] = four.y, key[i + 2] = four.z, key[i + 3] = four.w;
  }
  uint32_t heads = begin == 0 || args.keys[begin - 1] != key[0] ? 1 : 0;
#pragma unroll
  for (int i = 1; i < kKeysOfThread; ++i) heads |= key[i] != key[i - 1] ? 1u << i : 0;
  return heads & (here == uint32_t(kKeysOfThread) ? ~0u : (1u << here) - 1);
}

// first[chunk] receives the number of voxels that start in the chunk.
__global__ void __launch_bounds__(kBucketThreads) CountHeads(const __grid_constant__ SortedKeys args) {
  __shared__ uint32_t sums[kBucketThreads / 32];
  uint32_t key[kKeysOfThread];
  const uint64_t begin = uint64_t(blockIdx.x) * kKeysOfChunk + uint64_t(threadIdx.x) * kKeysOfThread;
  uint32_t sum = WarpSum(uint32_t(__popc(FindHeads(args, begin, key))));
  if (threadIdx.x % 32 == 0) sums[threadIdx.x / 32] = sum;
  __syncthreads();
  if (threadIdx.x > 0) return;
  for (int w = 1; w < kBucketThreads / 32; ++w) sum += sums[w];
  args.first[blockIdx.x] = sum;
}

// Writes voxels and the offsets of their fragments, followed by the number of all fragments. kCounts: single pass, with
// decoupled look-back instead of counts made before.
template <bool kCounts, typename Index>
__global__ void __launch_bounds__(kBucketThreads, 4) WriteBuckets(const __grid_constant__ BucketArgs<Index> args) {
  __shared__ uint32_t sums[kBucketThreads / 32];
  __shared__ uint16_t places[kKeysOfChunk];
  __shared__ uint64_t before;
  uint32_t key[kKeysOfThread];
  const uint64_t chunk = uint64_t(blockIdx.x) * kKeysOfChunk;
  const uint32_t heads = FindHeads(args, chunk + uint64_t(threadIdx.x) * kKeysOfThread, key);
  uint32_t in_warp;
  uint32_t at = WarpExclusiveSum(uint32_t(__popc(heads)), in_warp), total = 0;
  if (threadIdx.x % 32 == 0) sums[threadIdx.x / 32] = in_warp;
  __syncthreads();
#pragma unroll
  for (unsigned w = 0; w < kBucketThreads / 32; ++w) {
    if (w < threadIdx.x / 32) at += sums[w];
    total += sums[w];
  }
  if constexpr (kCounts) {
    const uint64_t words = (args.fragments + 31) / 32, word = chunk / 32 + threadIdx.x;
    static_assert(kKeysOfChunk / 32 <= kBucketThreads);
    for (int t = 0; t < args.ones_count && threadIdx.x < kKeysOfChunk / 32 && word < words; ++t) {
      args.ones[t][word] = WordOfOnes(args.fragments, word);
    }
    if (threadIdx.x < 32) {
      SayHere(args.first, total);
      const uint64_t sum = LookBack(args.first, total);
      if (threadIdx.x == 0) before = sum;
    }
  }
#pragma unroll
  for (int i = 0; i < kKeysOfThread; ++i) {
    if ((heads >> i & 1) == 0) continue;
    places[at] = uint16_t(threadIdx.x * kKeysOfThread + unsigned(i));
    ++at;
  }
  __syncthreads();
  const uint64_t to = kCounts ? before : args.first[blockIdx.x];
  for (uint32_t i = threadIdx.x; i < total; i += kBucketThreads) {
    args.offsets[to + i] = Index(chunk + places[i]);
    args.voxels[to + i] = Index(args.first_voxel + args.keys[chunk + places[i]]);
  }
  if (blockIdx.x + 1 < gridDim.x || threadIdx.x > 0) return;
  args.offsets[to + total] = Index(args.fragments);
  if constexpr (kCounts) *args.listed = to + total;
}

}  // namespace voxelpipe::cuda
