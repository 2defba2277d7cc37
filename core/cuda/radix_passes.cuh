// Pairs of 32 bits sorted by their keys, digit by digit: CUB's blocks in kernels that begin early, with one clearing for all passes, where CUB's
// own way has two before the digits are counted and one before each pass. Included by fragment_sort.cu only, for versions of CUB that it knows.
//
// Source: A. Adinets and D. Merrill, "Onesweep: A Faster Least Significant Digit Radix Sort for GPUs", arXiv:2206.01784, 2022.
#pragma once

#include <cub/agent/agent_radix_sort_histogram.cuh>
#include <cub/agent/agent_radix_sort_onesweep.cuh>
#include <cub/block/block_scan.cuh>

#include "base/host_device.h"
#include "cuda/early_launch.cuh"

namespace voxelpipe::cuda {

inline constexpr uint64_t kMostSortedByDigits = (1 << 30) - 1;  // what blocks say has 30 bits for a number

// Digits of kBits bits, and what a block of a pass takes: kThreads times kItems pairs.
template <int kBits, int kThreads, int kItems>
struct Digits {
  static constexpr int kOfDigit = kBits, kCount = 1 << kBits;
  static constexpr int kPassThreads = kThreads, kTile = kThreads * kItems;
  VOXELPIPE_HD static uint32_t TilesOf(uint32_t count) { return (count + kTile - 1) / kTile; }
  // Blocks of 128 threads, as CUB has them, add four times as many counts of theirs to those of all.
  static constexpr int kCountThreads = 512, kCountBlocks = 4;
  using CountAgent = cub::detail::radix_sort::AgentRadixSortHistogram<
      cub::AgentRadixSortHistogramPolicy<kCountThreads, 16, 1, uint32_t, kBits>, false, uint32_t, uint32_t>;
  using PassPolicy =
      cub::AgentRadixSortOnesweepPolicy<kThreads, kItems, uint32_t, 1, cub::RADIX_RANK_MATCH_EARLY_COUNTS_ANY,
                                        cub::BLOCK_SCAN_RAKING_MEMOIZE, cub::RADIX_SORT_STORE_DIRECT, kBits>;
  using PassAgent =
      cub::detail::radix_sort::AgentRadixSortOnesweep<PassPolicy, false, uint32_t, uint32_t, uint32_t, int>;
};

// All are 0 before. `starts`: of each pass, how many keys have each digit, and then how many have lesser ones. `taken`: of each pass, how many
// tiles blocks have taken. `said`: of each pass, what its blocks say of each digit.
struct RadixRoom {
  uint32_t* starts = nullptr;
  int *taken = nullptr, *said = nullptr;
};
struct RadixPairs {
  uint32_t *keys = nullptr, *values = nullptr;
};

__global__ void __launch_bounds__(256) ClearRadixRoom(uint4* room, uint64_t quads) {
  AllowNext();
  AwaitEarlier();
  for (uint64_t i = uint64_t(blockIdx.x) * 256 + threadIdx.x; i < quads; i += uint64_t(gridDim.x) * 256) {
    room[i] = uint4{0, 0, 0, 0};
  }
}

template <typename D>
__global__ void __launch_bounds__(D::kCountThreads, D::kCountBlocks)
    CountDigits(const uint32_t* keys, uint32_t count, int bits, uint32_t* starts) {
  __shared__ typename D::CountAgent::TempStorage room;
  AllowNext();
  AwaitEarlier();
  typename D::CountAgent(room, starts, keys, count, 0, bits).Process();
}

// A block a pass.
template <typename D>
__global__ void __launch_bounds__(D::kCount) SumDigits(uint32_t* starts) {
  using Sum = cub::BlockScan<uint32_t, D::kCount>;
  __shared__ typename Sum::TempStorage room;
  AllowNext();
  AwaitEarlier();
  uint32_t* const mine = starts + blockIdx.x * D::kCount + threadIdx.x;
  uint32_t before;
  Sum(room).ExclusiveSum(*mine, before);
  *mine = before;
}

// Pass number `pass`, by `bits` bits. Does not let the next kernel begin: blocks that only wait would take the room of another stream's, and without
// another one's a sort takes longer so too.
template <typename D>
__global__ void __launch_bounds__(D::kPassThreads)
    SortByDigit(RadixPairs from, RadixPairs to, uint32_t count, int pass, int bits, RadixRoom room) {
  __shared__ typename D::PassAgent::TempStorage shared;
  AwaitEarlier();
  typename D::PassAgent(shared, room.said + uint64_t(pass) * D::TilesOf(count) * D::kCount, room.taken + pass, nullptr,
                        room.starts + pass * D::kCount, to.keys, from.keys, to.values, from.values, int(count),
                        pass * D::kOfDigit, bits)
      .Process();
}

}  // namespace voxelpipe::cuda
