// Emits the A-buffer's fragments as groups ("bundles", fragment_group.h) from coverage records. No host-only includes.
#pragma once

#include "cuda/a_buffer/emit_records.cuh"
#include "cuda/primitives/decoupled_look_back.cuh"
#include "cuda/run/fragment_group.h"

namespace voxelpipe::cuda {

static_assert(kBundledTriangles == 32 * kCellsOfThread);

struct EmitBundleArgs : FragmentArgs {  // keys and values are those of groups
  BundleCode code;
  uint32_t rounds = 1;
  uint64_t* before = nullptr;   // block sums of LookBack, 0 at first
  uint64_t* bundles = nullptr;  // receives the number of groups
};

// Groups the `count` <= 32 fragments at room[from], one per lane, by voxel and writes the groups to room[to], where to
// <= from. Returns the number of groups. Placeholders of deferred triangles (possible only if `waits`) are copied
// unchanged, and no group spans triangles on both sides of one.
__device__ inline uint32_t BundleGroup(const BundleCode& code, bool waits, uint2 (&room)[kBundleRoom], uint32_t from,
                                       uint32_t count, uint32_t to) {
  const unsigned lane = threadIdx.x % 32;
  const uint32_t below = (1u << lane) - 1;
  const bool has = lane < count;
  static_assert(kMaxSpanBits <= uint64_t{~31u});  // so that ~lane is never a voxel
  const uint2 fragment = has ? room[from + lane] : uint2{~lane, 0};
  uint32_t voxel = fragment.x, waiting = 0;
  if (waits) {
    if (fragment.y == kNotHere) voxel = ~lane;
    waiting = __ballot_sync(~0u, fragment.y == kNotHere);
  }
  const int first = __ffs(int(__match_any_sync(~0u, voxel))) - 1;
  const uint32_t after = fragment.y - __shfl_sync(~0u, fragment.y, first);  // 0 for the first fragment
  bool follows = after - 1 < code.followers;
  if (waits) follows = follows && (waiting & below) >> first == 0;
  const uint32_t heads = __ballot_sync(~0u, has && !follows);
  __syncwarp();
  if (has && !follows) room[to + uint32_t(__popc(heads & below))] = fragment;
  __syncwarp();
  if (follows) atomicOr(&room[to + uint32_t(__popc(heads & ((1u << first) - 1)))].y, code.Bit(after));
  return uint32_t(__popc(heads));
}

// The range of triangles of a warp (empty past the last triangle). Indices are relative to its first triangle.
struct BundledTriangles {
  uint32_t first, here;

  __device__ BundledTriangles(const EmitBundleArgs& args, uint32_t number) {
    const uint32_t each = args.rounds * kBundledTriangles, all = uint32_t(args.triangles);
    static_assert(2 * kMaxSpanTriangles <= uint64_t{1} << 31);
    first = min(number * each, all);
    here = min(all - first, each);
  }
  // The lane's first triangle in the iteration that starts at `begin`.
  __device__ static uint32_t Local(uint32_t begin) { return begin + threadIdx.x % 32 * kCellsOfThread; }

  __device__ void Load(const EmitBundleArgs& args, uint32_t begin, uint64_t (&cells)[kCellsOfThread]) const {
#pragma unroll
    for (int i = 0; i < kCellsOfThread; ++i) {
      const uint32_t t = Local(begin) + uint32_t(i);
      cells[i] = t < here ? args.cells[first + t] : 0;
    }
  }
  __device__ CellsOfThread Take(const EmitBundleArgs& args, uint32_t begin,
                                const uint64_t (&cells)[kCellsOfThread]) const {
    CellsOfThread of;
#pragma unroll
    for (int i = 0; i < kCellsOfThread; ++i) {
      of.cell[i] = cells[i];
      if (KindOfCell(cells[i]) == CellKind::kBlock) of.mask[i] = args.blocks[first + Local(begin) + uint32_t(i)];
    }
    return of;
  }
  __device__ CellsOfThread Take(const EmitBundleArgs& args, uint32_t begin) const {
    uint64_t cells[kCellsOfThread];
    Load(args, begin, cells);
    return Take(args, begin, cells);
  }
};

// Fallback for a warp whose groups overflow its shared memory: the number of its fragments, each as a group of its own.
__device__ __noinline__ inline uint64_t CountPlainly(const EmitBundleArgs& args, BundledTriangles triangles) {
  uint64_t sum = 0;
  for (uint32_t begin = 0; begin < triangles.here; begin += kBundledTriangles) sum += triangles.Take(args, begin).all();
  return WarpSum(sum);
}
// Writes them from `out` on.
__device__ __noinline__ inline void WritePlainly(const EmitBundleArgs& args, BundledTriangles triangles, uint64_t out) {
  for (uint32_t begin = 0; begin < triangles.here; begin += kBundledTriangles) {
    const CellsOfThread of = triangles.Take(args, begin);
    const uint64_t upto = SumUpto(of.all());
    EmitCellsAt(args, uint64_t{triangles.first} + triangles.Local(begin), of, out + upto - of.all());
    out += __shfl_sync(~0u, upto, 31);
  }
}

// Groups a warp's fragments in its shared memory: bit indices of voxels, and codes with triangles relative to the
// warp's first. Returns the number of groups; kNotHere if they do not fit.
__device__ inline uint32_t BundleWarp(const EmitBundleArgs& args, const BundledTriangles& triangles,
                                      uint2 (&room)[kBundleRoom]) {
  const unsigned lane = threadIdx.x % 32;
  const BitSteps steps(args.grid);
  uint32_t bundles = 0;
  uint32_t staged = 0;  // fragments behind the groups that are not grouped yet; fewer than 32 carry over
  bool waits = false;
  uint64_t next[kCellsOfThread];
  triangles.Load(args, 0, next);
  for (uint32_t begin = 0; begin < triangles.here; begin += kBundledTriangles) {
    const CellsOfThread of = triangles.Take(args, begin, next);
    triangles.Load(args, begin + kBundledTriangles, next);
    waits = waits || __any_sync(~0u, of.waits(0) || of.waits(1)) != 0;
    static_assert(kCellsOfThread == 2);
    const uint32_t mine = of.few(kBundleRoom + 1);
    uint32_t all;
    const uint32_t before = WarpExclusiveSum(mine, all);
    for (uint32_t done = 0; done < all;) {  // one iteration if all fit
      const uint32_t room_left = kBundleRoom - bundles - staged;
      uint32_t end = all;
      if (all - done > room_left) {
        const uint32_t fit = __ballot_sync(~0u, before + mine <= done + room_left);
        end = __shfl_sync(~0u, before, __ffs(int(~fit)) - 1);
        if (end == done) return kNotHere;
      }
      if (before >= done && before < end) {
        StageCells(steps, of, triangles.Local(begin), room + (bundles + staged + (before - done)));
      }
      __syncwarp();
      staged += end - done;
      done = end;
      uint32_t from = bundles;
      for (; staged >= 32; staged -= 32, from += 32) {
        bundles += BundleGroup(args.code, waits, room, from, 32, bundles);
      }
      const uint2 left = lane < staged ? room[from + lane] : uint2{};
      __syncwarp();
      if (lane < staged) room[bundles + lane] = left;
    }
  }
  __syncwarp();
  bundles += BundleGroup(args.code, waits, room, bundles, staged, bundles);
  __syncwarp();
  return bundles;
}

// Emits the groups of all records. A block takes kChunkWarps * rounds * kBundledTriangles triangles. Each fragment of a
// deferred triangle is a group of its own, written by a later kernel. Supports programmatic dependent launch.
__global__ void __launch_bounds__(kChunkThreads, kBundleBlocks)
    EmitBundles(const __grid_constant__ EmitBundleArgs args) {
  __shared__ uint2 rooms[kChunkWarps][kBundleRoom];
  __shared__ uint64_t of_warps[kChunkWarps], block_begin;
  AllowNext();
  AwaitEarlier();
  if (threadIdx.x == 0) {
    for (uint64_t i = blockIdx.x; i < args.clear_count; i += gridDim.x) args.clear[i] = 0;
  }
  const unsigned lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  const BundledTriangles triangles(args, blockIdx.x * kChunkWarps + warp);
  const uint32_t bundles = BundleWarp(args, triangles, rooms[warp]);
  const uint64_t mine = bundles == kNotHere ? CountPlainly(args, triangles) : bundles;
  if (lane == 0) of_warps[warp] = mine;
  __syncthreads();
  uint64_t all;
  const uint64_t before = SumOfWarps(of_warps, all);
  if (warp == 0) {
    SayHere(args.before, all);
    const uint64_t begin = LookBack(args.before, all);
    if (lane == 0) {
      block_begin = begin;
      if (blockIdx.x + 1 == gridDim.x) *args.bundles = begin + all;
    }
  }
  __syncthreads();
  if (block_begin + all > args.room) return;
  const uint64_t out = block_begin + before;
  if (bundles == kNotHere) return WritePlainly(args, triangles, out);
  const uint32_t first = triangles.first;
  uint32_t *const keys = args.keys + out, *const values = args.values + out;
  for (uint32_t i = lane; i < bundles; i += 32) {
    const uint2 bundle = rooms[warp][i];
    if (bundle.y != kNotHere) {
      keys[i] = KeyOfBit(args.grid, bundle.x);
      values[i] = first + bundle.y;
    } else if (bundle.x != kNotHere) {
      args.blocks[first + bundle.x] = out + i;  // a later kernel writes them there
    }
  }
}

}  // namespace voxelpipe::cuda
