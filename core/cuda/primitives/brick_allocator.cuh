// Allocates slots of a fixed pool to bricks of a grid on demand, during rasterization: the first warp that touches a
// brick takes a slot for it (cf. the brick pool of C. Crassin et al., "GigaVoxels", I3D 2009, for rendering). In the
// code a slot is called a place. A `Pool` has `places` (the slot table, an element per brick), `asked` (a counter),
// `capacity`, kWordsOfPlace, WordsOf and Name.
//
// Memory ordering: a new slot number is read by an acquire load, after the allocating warp cleared the slot. A slot
// number found in the L1 cache needs no acquire: slots are accessed by atomics only, in the L2 cache, where the
// clearing is complete before the number is visible. No host-only includes.
#pragma once

#include <cstdint>

#include "cuda/primitives/acquire_release.cuh"
#include "cuda/primitives/atomics.cuh"

namespace voxelpipe::cuda {

// States of an element of `places`. Other values are kFirstPlace + slot number.
inline constexpr uint32_t kNoPlace = 0;       // not allocated
inline constexpr uint32_t kPlaceToCome = 1;   // a warp is allocating it
inline constexpr uint32_t kNoMorePlaces = 2;  // the pool is full
inline constexpr uint32_t kFirstPlace = 3;
__device__ inline bool IsPlace(uint32_t place) {
  return place >= kFirstPlace;
}

// Returns the brick's slot: allocates and clears it, or waits until another warp has done so. A warp that allocates
// never waits, so there is no deadlock. All lanes of a warp call it with the same brick.
template <typename Pool>
__device__ __noinline__ inline uint32_t GivePlace(const Pool& pool, uint32_t brick) {
  const unsigned lane = threadIdx.x % 32;
  uint32_t place = 0;
  if (lane == 0) place = atomicCAS(pool.places + brick, kNoPlace, kPlaceToCome);
  place = __shfl_sync(~0u, place, 0);
  if (place != kNoPlace) {
    do {
      if (lane == 0) place = LoadAcquire(pool.places + brick);
      place = __shfl_sync(~0u, place, 0);
    } while (place == kPlaceToCome);
    __syncwarp();  // after what lane 0 acquired
    return place;
  }
  unsigned long long number = 0;
  if (lane == 0) number = atomicAdd(reinterpret_cast<unsigned long long*>(pool.asked), 1ull);
  number = __shfl_sync(~0u, number, 0);
  place = kNoMorePlaces;
  if (number < pool.capacity) {
    place = kFirstPlace + uint32_t(number);
    auto* const words = reinterpret_cast<uint4*>(pool.WordsOf(number));
#pragma unroll
    for (unsigned i = lane; i < Pool::kWordsOfPlace / 4; i += 32) words[i] = uint4{0, 0, 0, 0};
    if (lane == 0) pool.Name(number, brick);
  }
  __syncwarp();
  if (lane == 0) {
    __threadfence();  // the slot is cleared before its number is visible
    StoreRelaxed(pool.places + brick, place);
  }
  return place;
}

// Returns the slot of each lane's brick; kNoMorePlaces if `wants` is false or the pool is full. All lanes of a warp
// call it.
template <typename Pool>
__device__ inline uint32_t PlaceOf(const Pool& pool, bool wants, uint32_t brick) {
  uint32_t place = kNoMorePlaces;
  if (wants) {
    place = __ldca(pool.places + brick);
    // Another multiprocessor may have allocated it since.
    if (place < kNoMorePlaces) place = LoadAcquire(pool.places + brick);
  }
  uint32_t waiting = __ballot_sync(~0u, place < kNoMorePlaces);
  while (waiting != 0) {
    const uint32_t next = __shfl_sync(~0u, brick, __ffs(int(waiting)) - 1);
    const uint32_t given = GivePlace(pool, next);
    const bool mine = wants && brick == next;
    if (mine) place = given;
    waiting &= ~__ballot_sync(~0u, mine);
  }
  return place;
}

// The same for a single thread, if the pool has slots for all bricks.
template <typename Pool>
__device__ __noinline__ inline uint32_t TakePlace(const Pool& pool, uint32_t brick) {
  uint32_t place = atomicCAS(pool.places + brick, kNoPlace, kPlaceToCome);
  if (place == kNoPlace) {
    const unsigned long long number = atomicAdd(reinterpret_cast<unsigned long long*>(pool.asked), 1ull);
    auto* const words = reinterpret_cast<uint4*>(pool.WordsOf(number));
    for (unsigned i = 0; i < Pool::kWordsOfPlace / 4; ++i) words[i] = uint4{0, 0, 0, 0};
    pool.Name(number, brick);
    place = kFirstPlace + uint32_t(number);
    __threadfence();  // the slot is cleared before its number is visible
    StoreRelaxed(pool.places + brick, place);
    return place;
  }
  // Lanes of one warp diverge here: the allocating lane has finished above before others spin.
  do {
    place = LoadAcquire(pool.places + brick);
  } while (place == kPlaceToCome);
  return place;
}

}  // namespace voxelpipe::cuda
