// Triangles that blocks of one kernel pass on to warps of the next one, which has begun early and takes them as they come: so what is left of a small
// mesh does not wait for the kernel's end. Each block has a box of kMailWords words: triangles, each one more than its number, or 0; and one more
// than how many there are, when there will be no more. All are 0 before and after.
//
// For grids that the first kernel clears itself (args.clear_blocks): who takes a triangle looks whether that is done, which the block that posted it has
// waited for. A release with each triangle would wait for all that its thread has set, 1 us of 16. No host-only includes.
#pragma once

#include "cuda/bit_layers.cuh"
#include "cuda/bit_mail.h"
#include "cuda/early_launch.cuh"
#include "cuda/ordered_access.cuh"

namespace voxelpipe::cuda {

inline constexpr uint32_t kMostMailed = kMailWords - 1;
static_assert(kMostMailed <= kMostInParts);

__device__ inline uint32_t* MailBox(const BitArgs& args, uint32_t box) {
  return args.mail + uint64_t{box} * kMailWords;
}

// The block's triangle number `place`, less than kMostMailed.
__device__ inline void PostTriangle(const BitArgs& args, uint32_t box, uint32_t place, uint32_t t) {
  StoreRelaxed(MailBox(args, box) + place, t + 1);
}
// By one thread of a block: it has posted, or will have, `count` in all.
__device__ inline void EndMail(const BitArgs& args, uint32_t box, uint32_t count) {
  StoreRelaxed(MailBox(args, box) + kMostMailed, count + 1);
}

// Takes all triangles of boxes `warp`, warp + warps, ..., and leaves these empty. A kernel that calls it begins when all blocks that post have begun.
// `shared` has room for kSetups, at least kMostInParts. All threads of a warp call it.
template <int kSetups>
__device__ inline void WalkMail(const BitArgs& args, uint32_t warp, uint32_t warps, SharedSetup* shared) {
  static_assert(kSetups >= int(kMostInParts));
  const uint32_t lane = threadIdx.x % 32, place = lane / kBoundsParts;
  for (uint32_t b = warp; b < args.mail_boxes; b += warps) {
    uint32_t* const box = MailBox(args, b);
    uint32_t taken = 0, count = ~0u;
    while (uint32_t(__popc(taken)) != count) {
      const uint32_t word = lane < kMailWords ? LoadRelaxed(box + lane) : 0;
      const uint32_t end = __shfl_sync(~0u, word, kMostMailed);
      if (end != 0) count = end - 1;
      const uint32_t come = __ballot_sync(~0u, word != 0 && lane < kMostMailed) & ~taken;
      if (come == 0) continue;
      taken |= come;
      const uint32_t brought = __shfl_sync(~0u, word, int(place));
      const uint32_t t = (come >> place & 1) != 0 ? brought - 1 : kNoTriangle;
      const uint32_t vertex = CornerInParts(args, t);  // on its way meanwhile
      // Where somebody has set the counter back, the kernel before has ended.
      const bool cleared = LoadAcquire(args.cleared) >= args.clear_blocks;
      if (!__all_sync(~0u, cleared)) AwaitEarlier();
      const uint64_t rows = RowsOfLane(SetUpCornersInParts(args, t, vertex, shared[place]));
      WalkSetUp<kSetups>(args, shared, rows == 0 ? 0 : LayersOf(shared[lane]));
    }
    if (lane < kMailWords) StoreRelaxed(box + lane, 0);
  }
}

}  // namespace voxelpipe::cuda
