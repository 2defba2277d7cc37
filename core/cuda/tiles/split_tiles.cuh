// Tiles with very many triangles are split: a part of its pairs is one block's, and blocks join what they blended. No
// host-only includes.
//
// Every blend is independent of order, so joined parts hold what one block would have blended. A block that is done
// with a part leaves it in global memory; of the blocks whose parts belong together the last one that is done joins
// them, and goes on so up a tree until one has the whole tile.
#pragma once

#include "cuda/primitives/blend_rules.cuh"
#include "cuda/primitives/shading_args.h"

namespace voxelpipe::cuda {

// What a block takes: a tile's pairs, or a part of them.
struct TileWork {
  uint32_t slot = 0;  // of the occupied tiles
  uint32_t tile = 0;
  uint32_t begin = 0, end = 0;  // pairs
  uint32_t part = 0, parts = 1;
  uint32_t first_part = 0;  // place of the tile's parts among all
};

// The work of a number from the counter: first the parts, then the tiles that are not split. False: there is none for
// that number.
__device__ inline bool TakeWork(const FineArgs& args, uint64_t number, TileWork& work) {
  const uint64_t listed = args.parts.list == nullptr ? 0 : *args.parts.count;
  if (number < listed) {
    const TilePart part = args.parts.list[number];
    work.slot = part.slot;
    work.part = part.part;
    work.first_part = uint32_t(number) - part.part;
  } else {
    work.slot = uint32_t(number - listed);
    work.part = work.first_part = 0;
  }
  work.tile = args.occupied_tiles[work.slot];
  work.begin = args.tile_begin[work.tile];
  work.end = args.tile_end[work.tile];
  work.parts = args.parts.list == nullptr ? 1 : PartsOf(work.end - work.begin, args.parts.pairs);
  if (work.parts == 1) return true;
  if (number >= listed) return false;
  work.begin += work.part * args.parts.pairs;
  work.end = work.part + 1 == work.parts ? work.end : work.begin + args.parts.pairs;
  return true;
}

// Joins a target's tile with another one's of the same words, for voxels or rows that the calling thread shares out.
__device__ inline void JoinTarget(const TileTarget& t, uint32_t* shared, const uint32_t* other) {
  const int thread = int(threadIdx.x), threads = int(blockDim.x);
  const int components = t.target.components, cells = kTileVoxels * components;
  const auto each = [&](int at, int words, auto&& join) {
    for (int i = thread; i < words; i += threads) shared[at + i] = join(shared[at + i], __ldcg(other + at + i));
  };
  const auto either = [](uint32_t a, uint32_t b) { return a | b; };
  const auto both = [](uint32_t a, uint32_t b) { return a & b; };
  const auto sum = [](uint32_t a, uint32_t b) { return a + b; };
  if (t.target.own_presence) each(t.presence, kTileRows, either);
  switch (t.kept) {
    case Kept::kNothing: return;
    case Kept::kBitOr: return each(t.bits, kTileRows, either);
    case Kept::kBitAnd: return each(t.bits, kTileRows, both);
    case Kept::kMin: return each(t.cells, cells, [](uint32_t a, uint32_t b) { return Min(a, b); });
    case Kept::kMax: return each(t.cells, cells, [](uint32_t a, uint32_t b) { return Max(a, b); });
    case Kept::kOr: return each(t.cells, cells, either);
    case Kept::kAnd: return each(t.cells, cells, both);
    case Kept::kCount: return each(t.counts, kTileVoxels, sum);
    case Kept::kAverage: each(t.counts, kTileVoxels, sum); [[fallthrough]];
    case Kept::kSum: {
      auto* const sums = reinterpret_cast<unsigned long long*>(shared + t.sums);
      const auto* const more = reinterpret_cast<const unsigned long long*>(other + t.sums);
      for (int i = thread; i < cells; i += threads) sums[i] += __ldcg(more + i);
      return;
    }
    case Kept::kOwner:
    case Kept::kBitOfOwner: break;
  }
  // A warp takes a row.
  for (int voxel = thread; voxel < kTileVoxels; voxel += threads) {
    const uint32_t key = __ldcg(other + t.owner + voxel);
    const bool wins = key > shared[t.owner + voxel];
    if (wins) shared[t.owner + voxel] = key;
    if (t.kept == Kept::kOwner) {
      for (int c = 0; wins && c < components; ++c) {
        shared[t.cells + voxel * components + c] = __ldcg(other + t.cells + voxel * components + c);
      }
      continue;
    }
    const uint32_t mask = __ballot_sync(~0u, wins);
    uint32_t* const bits = shared + t.bits + voxel / 32;
    if (voxel % 32 == 0) *bits = (*bits & ~mask) | (__ldcg(other + t.bits + voxel / 32) & mask);
  }
}

// Leaves a part's result, or joins it with those of others. True where the block then has the whole tile in `shared`,
// `touched` and `covered`. All threads call it, with blending done and a barrier behind it.
__device__ inline bool JoinParts(const FineArgs& args, const TileWork& work, uint32_t* shared, uint32_t* touched,
                                 uint32_t* covered) {
  __shared__ uint32_t joins;
  const int thread = int(threadIdx.x), threads = int(blockDim.x);
  const int words = args.shared_words;
  const uint64_t stride = uint64_t(words) + 2 * kTileRows;
  uint32_t* const results = args.parts.results + work.first_part * stride;
  uint32_t mine = work.part;  // the first part of what the block has
  uint32_t* done = args.parts.done + work.first_part;
  for (uint32_t span = 1; span < work.parts; span *= kPartsJoined, done += args.parts.capacity) {
    const uint32_t first = mine / (span * kPartsJoined) * (span * kPartsJoined);
    const uint32_t members = Min((work.parts - first + span - 1) / span, kPartsJoined);
    if (members == 1) continue;
    uint32_t* const here = results + mine * stride;
    for (int i = thread; i < words; i += threads) here[i] = shared[i];
    for (int i = thread; i < kTileRows; i += threads) {
      here[words + i] = touched[i];
      here[words + kTileRows + i] = covered[i];
    }
    __threadfence();
    __syncthreads();
    if (thread == 0) {
      joins = atomicAdd(done + first, 1u) + 1 == members;
      if (joins) done[first] = 0;  // for the next launch
    }
    __syncthreads();
    const bool last = joins != 0;
    __syncthreads();
    if (!last) return false;
    __threadfence();
    for (uint32_t m = 0; m < members; ++m) {
      if (first + m * span == mine) continue;
      const uint32_t* const other = results + (first + m * span) * stride;
      for (int i = 0; i < args.target_count; ++i) JoinTarget(args.targets[i], shared, other);
      for (int i = thread; i < kTileRows; i += threads) {
        touched[i] |= __ldcg(other + words + i);
        covered[i] |= __ldcg(other + words + kTileRows + i);
      }
      __syncthreads();
    }
    mine = first;
  }
  return true;
}

}  // namespace voxelpipe::cuda
