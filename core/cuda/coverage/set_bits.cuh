// Enumerates the set bits of a mostly empty bit grid, so that every lane of a warp has one. No host-only includes.
#pragma once

#include "cuda/traversal/row_traversal.cuh"

namespace voxelpipe::cuda {

// Loads words [at, at + 4) of an array, `at` a multiple of 4; words past the end read as 0.
__device__ inline uint4 FourWords(const uint32_t* array, uint64_t at, uint64_t words) {
  if (at + 4 <= words) return *reinterpret_cast<const uint4*>(array + at);
  uint4 four{0, 0, 0, 0};
  if (at < words) four.x = array[at];
  if (at + 1 < words) four.y = array[at + 1];
  if (at + 2 < words) four.z = array[at + 2];
  return four;
}

// The position of set bit number n of a mask that has more than n.
__device__ inline uint32_t SelectBit(uint32_t mask, uint32_t n) {
  uint32_t at = 0;
#pragma unroll
  for (uint32_t width = 16; width > 0; width /= 2) {
    const auto low = uint32_t(__popc(mask & ((1u << width) - 1)));
    if (n < low) continue;
    n -= low;
    at += width;
    mask >>= width;
  }
  return at;
}
__device__ inline uint32_t SelectBit(uint64_t mask, uint32_t n) {
  const auto low = uint32_t(__popc(uint32_t(mask)));
  return n < low ? SelectBit(uint32_t(mask), n) : 32 + SelectBit(uint32_t(mask >> 32), n - low);
}

inline constexpr uint64_t kWordsOfWarp = 128;  // words per iteration of a warp

// The set bits of a warp's kWordsOfWarp words, numbered in order. All lanes call each function.
class SetBits {
 public:
  // For the words from `begin` on.
  __device__ SetBits(const uint32_t* grid, uint64_t begin, uint64_t words)
      : begin_(begin), four_(FourWords(grid, begin + threadIdx.x % 32 * 4, words)) {
    before_ = WarpExclusiveSum(uint32_t(__popc(four_.x) + __popc(four_.y) + __popc(four_.z) + __popc(four_.w)), total_);
  }
  __device__ uint32_t total() const { return total_; }
  // Position of set bit `number`; undefined if there are not so many.
  __device__ void Find(uint32_t number, uint64_t& word, uint32_t& x) const {
    const int owner = LaneOfItem(before_, number);
    int left = int(number - __shfl_sync(~0u, before_, owner));
    const uint32_t of[4] = {__shfl_sync(~0u, four_.x, owner), __shfl_sync(~0u, four_.y, owner),
                            __shfl_sync(~0u, four_.z, owner), __shfl_sync(~0u, four_.w, owner)};
    if (number >= total_) return;
    uint32_t bits = of[0];
    int which = 0;
#pragma unroll
    for (int next = 1; next < 4; ++next) {
      if (which == next - 1 && left >= __popc(bits)) left -= __popc(bits), bits = of[next], which = next;
    }
    word = begin_ + uint64_t(owner) * 4 + uint64_t(which);
    x = SelectBit(bits, uint32_t(left));
  }

 private:
  uint64_t begin_;
  uint4 four_;
  uint32_t before_, total_;
};

// Calls visit(word, x) for every set bit of a bit grid that is aligned to 16 bytes, one bit per lane. The words are
// divided among `warps` warps; this is number `warp`. All lanes call it.
template <typename Visit>
__device__ inline void ForEachSetBit(const uint32_t* grid, uint64_t words, uint64_t warp, uint64_t warps,
                                     Visit&& visit) {
  for (uint64_t begin = warp * kWordsOfWarp; begin < words; begin += warps * kWordsOfWarp) {
    const SetBits bits(grid, begin, words);
    for (uint32_t first = 0; first < bits.total(); first += 32) {
      const uint32_t number = first + threadIdx.x % 32;
      uint64_t word = 0;
      uint32_t x = 0;
      bits.Find(number, word, x);
      if (number < bits.total()) visit(word, x);
    }
  }
}

}  // namespace voxelpipe::cuda
