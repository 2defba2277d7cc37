// Places of a pool that are given to bricks of a grid while triangles are drawn: whoever touches one first takes one
// for it (C. Crassin et al., "GigaVoxels", I3D 2009, has such a pool for rendering). A `Pool` has `places`, an element
// a brick, `asked`, `capacity`, kWordsOfPlace, and what WordsOf and Name do.
//
// A place that was not there before is read by an acquire, behind the clearing of who gave it. One that the L1 cache
// has, or brings, is not: what is done to a place are atomics of the L2 cache, which has it cleared before anyone can
// see it. No host-only includes.
#pragma once

#include <cstdint>

#include "cuda/primitives/acquire_release.cuh"
#include "cuda/primitives/atomics.cuh"

namespace voxelpipe::cuda {

// Elements of `places`. Others are kFirstPlace and the place's number.
inline constexpr uint32_t kNoPlace = 0;       // none was asked for
inline constexpr uint32_t kPlaceToCome = 1;   // a warp is about to give one
inline constexpr uint32_t kNoMorePlaces = 2;  // there was none left
inline constexpr uint32_t kFirstPlace = 3;
__device__ inline bool IsPlace(uint32_t place) {
  return place >= kFirstPlace;
}

// Gives a brick its place, empty, or waits until another warp has done so; every warp that gives one goes on without
// waiting for others. All lanes of a warp call it, with the same brick.
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
    __syncwarp();  // behind what lane 0 saw
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
    __threadfence();  // whoever sees the place finds it empty
    StoreRelaxed(pool.places + brick, place);
  }
  return place;
}

// The place of each lane's brick; kNoMorePlaces where it does not want one. All lanes of a warp call it.
template <typename Pool>
__device__ inline uint32_t PlaceOf(const Pool& pool, bool wants, uint32_t brick) {
  uint32_t place = kNoMorePlaces;
  if (wants) {
    place = __ldca(pool.places + brick);
    if (place < kNoMorePlaces) place = LoadAcquire(pool.places + brick);  // given by another multiprocessor since
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

// The same by one thread, where there are places for all bricks.
template <typename Pool>
__device__ __noinline__ inline uint32_t TakePlace(const Pool& pool, uint32_t brick) {
  uint32_t place = atomicCAS(pool.places + brick, kNoPlace, kPlaceToCome);
  if (place == kNoPlace) {
    const unsigned long long number = atomicAdd(reinterpret_cast<unsigned long long*>(pool.asked), 1ull);
    auto* const words = reinterpret_cast<uint4*>(pool.WordsOf(number));
    for (unsigned i = 0; i < Pool::kWordsOfPlace / 4; ++i) words[i] = uint4{0, 0, 0, 0};
    pool.Name(number, brick);
    place = kFirstPlace + uint32_t(number);
    __threadfence();  // whoever sees the place finds it empty
    StoreRelaxed(pool.places + brick, place);
    return place;
  }
  // Lanes that wait do so behind what another of their warp does to give it.
  do {
    place = LoadAcquire(pool.places + brick);
  } while (place == kPlaceToCome);
  return place;
}

}  // namespace voxelpipe::cuda
