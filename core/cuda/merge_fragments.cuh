// Two sorted lists of fragments to one, by voxel and then by triangle. No host-only includes.
//
// Source: S. Odeh, O. Green, Z. Mwassi, O. Shmueli and Y. Birk, "Merge Path - Parallel Merging Made Simple", IPDPSW 2012: how many of the first
// `d` of the merged list come from each is found by bisection, so every block, and every thread of it, merges as many.
#pragma once

#include "cuda/apart_views.h"
#include "cuda/bucket_views.h"
#include "cuda/early_launch.cuh"
#include "cuda/look_back.cuh"
#include "cuda/row_walk.cuh"
#include "cuda/warp_sum.cuh"

namespace voxelpipe::cuda {

inline constexpr uint32_t kMergeThreads = 256, kMergeBlocks = 7;  // of a multiprocessor at once
inline constexpr uint32_t kMergedOfThread = 9;  // odd: threads write to different banks of shared memory
inline constexpr uint32_t kMergedOfBlock = kMergeThreads * kMergedOfThread;

VOXELPIPE_HD uint64_t MergeBlocksOf(const MergeArgs& args) {
  return (args.count() + kMergedOfBlock - 1) / kMergedOfBlock;
}

// Whether a fragment comes behind another one.
__device__ inline bool IsBehind(const SortedFragments& a, uint64_t i, const SortedFragments& b, uint64_t j) {
  const uint32_t of_a = a.keys[i], of_b = b.keys[j];
  return of_a > of_b || (of_a == of_b && a.triangles[i] > b.triangles[j]);
}

// That look for a split: more of them look at more of memory, fewer have more steps to wait for.
inline constexpr unsigned kSplitLanes = 4;

// How many of the first `d` fragments of both are the first list's. No two are alike. Some neighbouring lanes each have a `d`, all of a warp call it.
__device__ inline uint64_t FindSplit(const MergeArgs& args, uint64_t d) {
  const unsigned lane = threadIdx.x % kSplitLanes, shift = threadIdx.x % 32 - lane;
  uint64_t lo = d > args.from[1].count ? d - args.from[1].count : 0, hi = min(d, args.from[0].count);
  // The least place in [lo, hi] whose fragment comes behind what the other list has left of `d`.
  while (__any_sync(~0u, lo < hi)) {
    const uint64_t step = (hi - lo + kSplitLanes - 1) / kSplitLanes, at = min(lo + uint64_t{lane + 1} * step, hi) - 1;
    const bool behind = lo < hi && IsBehind(args.from[0], at, args.from[1], d - 1 - at);
    const unsigned all = __ballot_sync(~0u, behind) >> shift & ((1u << kSplitLanes) - 1);
    const int first = all == 0 ? int(kSplitLanes) : __ffs(int(all)) - 1;
    const uint64_t end = __shfl_sync(~0u, at, first & int(kSplitLanes - 1), kSplitLanes),
                   before = __shfl_sync(~0u, at, (first + int(kSplitLanes) - 1) & int(kSplitLanes - 1), kSplitLanes);
    if (lo >= hi) continue;
    if (first > 0) lo = before + 1;
    if (first < int(kSplitLanes)) hi = end;
  }
  return lo;
}

// Where blocks begin. May begin early.
__global__ void __launch_bounds__(kMergeThreads) FindSplits(const __grid_constant__ MergeArgs args) {
  AllowNext();
  AwaitEarlier();
  const uint64_t all = args.count(), blocks = MergeBlocksOf(args);
  const uint64_t i = (uint64_t(blockIdx.x) * kMergeThreads + threadIdx.x) / kSplitLanes;
  const uint64_t split = FindSplit(args, min(i * kMergedOfBlock, all));
  if (threadIdx.x % kSplitLanes > 0 || i > blocks) return;
  args.splits[i] = split;
  if (i < blocks) args.before[i] = 0;
}

struct MergeRoom {
  uint64_t fragments[kMergedOfBlock];
};

// The block's part of the merged list, in room.fragments, and how long it is: kMergedOfBlock fragments, or in the end fewer. Those of the thread, from
// number threadIdx.x * kMergedOfThread of the part on, in `mine`. All threads of the block call it.
__device__ inline uint32_t MergeOfBlock(const MergeArgs& args, MergeRoom& room, uint64_t (&mine)[kMergedOfThread]) {
  const uint64_t begin = uint64_t(blockIdx.x) * kMergedOfBlock;
  const auto here = uint32_t(min(args.count() - begin, uint64_t{kMergedOfBlock}));
  const uint64_t first = args.splits[blockIdx.x], second = begin - first;
  const auto of_first = uint32_t(args.splits[blockIdx.x + 1] - first), of_second = here - of_first;
  // All are on their way before the first is put away.
  const uint32_t* const keys[2] = {args.from[0].keys + first, args.from[1].keys + (int64_t(second) - of_first)};
  const uint32_t* const triangles[2] = {args.from[0].triangles + first,
                                        args.from[1].triangles + (int64_t(second) - of_first)};
#pragma unroll
  for (uint32_t k = 0; k < kMergedOfThread; ++k) {
    const uint32_t i = k * kMergeThreads + threadIdx.x;
    if (i < here)
      mine[k] = uint64_t{(i < of_first ? keys[0] : keys[1])[i]} << 32 | (i < of_first ? triangles[0] : triangles[1])[i];
  }
#pragma unroll
  for (uint32_t k = 0; k < kMergedOfThread; ++k) {
    const uint32_t i = k * kMergeThreads + threadIdx.x;
    if (i < here) room.fragments[i] = mine[k];
  }
  __syncthreads();
  const uint64_t *const a = room.fragments, *const b = room.fragments + of_first;
  const uint32_t d = min(threadIdx.x * kMergedOfThread, here);
  uint32_t lo = d > of_second ? d - of_second : 0, hi = min(d, of_first);
  while (lo < hi) {
    const uint32_t middle = (lo + hi) / 2;
    if (a[middle] > b[d - 1 - middle]) {
      hi = middle;
    } else {
      lo = middle + 1;
    }
  }
  constexpr uint64_t kNone = ~uint64_t{0};
  uint32_t i = lo, j = d - lo;
  uint64_t next_a = i < of_first ? a[i] : kNone, next_b = j < of_second ? b[j] : kNone;
#pragma unroll
  for (uint32_t k = 0; k < kMergedOfThread; ++k) {
    const bool of_a = next_a < next_b;
    mine[k] = of_a ? next_a : next_b;
    i += of_a ? 1 : 0;
    j += of_a ? 0 : 1;
    const bool has = of_a ? i < of_first : j < of_second;
    const uint64_t next = has ? room.fragments[of_a ? i : of_first + j] : kNone;
    next_a = of_a ? next : next_a;
    next_b = of_a ? next_b : next;
  }
  __syncthreads();
#pragma unroll
  for (uint32_t k = 0; k < kMergedOfThread; ++k) {
    if (d + k < here) room.fragments[d + k] = mine[k];
  }
  __syncthreads();
  return here;
}

// The merged list. May begin early.
__global__ void __launch_bounds__(kMergeThreads, kMergeBlocks) MergeLists(const __grid_constant__ MergeArgs args) {
  __shared__ MergeRoom room;
  AllowNext();
  AwaitEarlier();
  uint64_t mine[kMergedOfThread];
  const uint32_t here = MergeOfBlock(args, room, mine);
  const uint64_t begin = uint64_t(blockIdx.x) * kMergedOfBlock;
  for (uint32_t k = threadIdx.x; k < here; k += kMergeThreads) {
    args.keys[begin + k] = uint32_t(room.fragments[k] >> 32);
    args.triangles[begin + k] = uint32_t(room.fragments[k]);
  }
}

struct MergeBucketRoom : MergeRoom {
  uint16_t places[kMergedOfBlock];  // of fragments that begin a voxel
  uint32_t sums[kMergeThreads / 32];
  uint64_t before;
};

// The merged list's triangles and buckets, as WriteBuckets has them; the keys are not kept. May begin early.
__global__ void __launch_bounds__(kMergeThreads, kMergeBlocks)
    MergeIntoBuckets(const __grid_constant__ MergeArgs args, const __grid_constant__ BucketArgs<uint64_t> buckets) {
  __shared__ MergeBucketRoom room;
  AllowNext();
  AwaitEarlier();
  uint64_t mine[kMergedOfThread];
  const uint32_t here = MergeOfBlock(args, room, mine), d = threadIdx.x * kMergedOfThread;
  const uint64_t begin = uint64_t(blockIdx.x) * kMergedOfBlock;
  uint32_t heads = 0;
  if (d < here) {
    uint32_t last;  // the key before, or another one where there is none
    if (d > 0) {
      last = uint32_t(room.fragments[d - 1] >> 32);
    } else {
      const uint64_t first = args.splits[blockIdx.x], second = begin - first;
      last = ~uint32_t(mine[0] >> 32);
      if (first > 0) last = args.from[0].keys[first - 1];
      if (second > 0 && args.from[1].keys[second - 1] == uint32_t(mine[0] >> 32)) last = uint32_t(mine[0] >> 32);
    }
#pragma unroll
    for (uint32_t k = 0; k < kMergedOfThread; ++k) {
      const auto key = uint32_t(mine[k] >> 32);
      heads |= key != last && d + k < here ? 1u << k : 0;
      last = key;
    }
  }
  uint32_t in_warp;
  uint32_t at = WarpExclusiveSum(uint32_t(__popc(heads)), in_warp), total;
  if (threadIdx.x % 32 == 0) room.sums[threadIdx.x / 32] = in_warp;
  __syncthreads();
  at += SumOfWarps(room.sums, total);
  if (threadIdx.x < 32) SayHere(buckets.first, total);
#pragma unroll
  for (uint32_t k = 0; k < kMergedOfThread; ++k) {
    if ((heads >> k & 1) != 0) room.places[at++] = uint16_t(d + k);
  }
  for (uint32_t k = threadIdx.x; k < here; k += kMergeThreads) {
    __stcs(args.triangles + begin + k, uint32_t(room.fragments[k]));
  }
  const uint64_t words = (buckets.fragments + 31) / 32, word = begin / 32 + threadIdx.x;
  static_assert(kMergedOfBlock % 32 == 0 && kMergedOfBlock / 32 <= kMergeThreads);
  for (int t = 0; t < buckets.ones_count && threadIdx.x < kMergedOfBlock / 32 && word < words; ++t) {
    buckets.ones[t][word] = WordOfOnes(buckets.fragments, word);
  }
  if (threadIdx.x < 32) {  // last: those before have come as far by now
    const uint64_t sum = LookBack(buckets.first, total);
    if (threadIdx.x == 0) room.before = sum;
  }
  __syncthreads();
  const uint64_t to = room.before;
  for (uint32_t i = threadIdx.x; i < total; i += kMergeThreads) {
    const uint32_t place = room.places[i];
    __stcs(Counted(buckets.offsets + to + i), 0ull + begin + place);
    __stcs(Counted(buckets.voxels + to + i), 0ull + buckets.first_voxel + uint32_t(room.fragments[place] >> 32));
  }
  if (blockIdx.x + 1 < gridDim.x || threadIdx.x > 0) return;
  buckets.offsets[to + total] = buckets.fragments;
  *buckets.listed = to + total;
}

}  // namespace voxelpipe::cuda
