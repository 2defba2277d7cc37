// Words of a bit grid that a warp's triangles reach, in shared memory: where triangles lie together many set the same word, which then goes to
// the grid once. No host-only includes.
#pragma once

#include "cuda/bit_grid.cuh"
#include "cuda/warp_sum.cuh"

namespace voxelpipe::cuda {

inline constexpr uint32_t kBoxWords = 128;

// A warp's: its words are zero between uses.
struct WordBox {
  uint32_t words[kBoxWords];
  int first[3];  // word along x, row, layer
  uint32_t size_x, size_y, count;
};

__device__ inline void ClearBox(WordBox& box) {
  for (uint32_t i = threadIdx.x % 32; i < kBoxWords; i += 32) box.words[i] = 0;
}

// Where a word lies in a WordBox; the same in all lanes.
struct BoxPlace {
  int offset = 0;
  // Of rows, and above 16 bits of layers; 0: the triangles reach too far, and their bits are set in the grid.
  uint32_t pitch = 0;

  __device__ bool fits() const { return pitch != 0; }
  __device__ int At(int word, int y, int z) const {
    return offset + word + y * int(pitch & 0xffff) + z * int(pitch >> 16);
  }
};

// The box of what the lanes with `has` reach, voxels [begin, end) of the grid. All lanes call it.
__device__ inline BoxPlace FitBox(WordBox& box, bool has, const int (&begin)[3], const int (&end)[3]) {
  const uint32_t from[3] = {uint32_t(begin[0]) >> 5, uint32_t(begin[1]), uint32_t(begin[2])};
  const uint32_t last[3] = {uint32_t(end[0] - 1) >> 5, uint32_t(end[1] - 1), uint32_t(end[2] - 1)};
  uint32_t least[3], size[3];
  WarpBox(has, from, last, least, size);
  BoxPlace place;
  if (least[0] == ~0u || size[0] > kBoxWords || size[1] > kBoxWords || size[2] > kBoxWords ||
      size[0] * size[1] * size[2] > kBoxWords) {
    return place;
  }
  place.pitch = size[0] | (size[0] * size[1]) << 16;
  place.offset = -(int(least[0]) + int(least[1]) * int(size[0]) + int(least[2]) * int(size[0] * size[1]));
  if (threadIdx.x % 32 == 0) {
    for (int a = 0; a < 3; ++a) box.first[a] = int(least[a]);
    box.size_x = size[0];
    box.size_y = size[1];
    box.count = size[0] * size[1] * size[2];
  }
  return place;
}

// i / n of small numbers.
__device__ inline uint32_t DivideSmall(uint32_t i, float inverse) {
  return uint32_t((float(i) + 0.5f) * inverse);
}

// Brings the words to the grid and clears them. All lanes call it, when all have set their bits and __syncwarp.
__device__ inline void StoreBox(const BitArgs& args, WordBox& box) {
  const uint32_t count = box.count, size_x = box.size_x, size_y = box.size_y;
  const float inverse_x = 1.0f / float(size_x), inverse_y = 1.0f / float(size_y);
  for (uint32_t i = threadIdx.x % 32; i < count; i += 32) {
    const uint32_t bits = box.words[i];
    if (bits == 0) continue;
    box.words[i] = 0;
    const uint32_t row = DivideSmall(i, inverse_x), z = DivideSmall(row, inverse_y);
    const uint32_t word = uint32_t(box.first[0]) + (i - row * size_x);
    ReduceOr(args.bits + args.grid.Word(0, box.first[1] + int(row - z * size_y), box.first[2] + int(z)) + word, bits);
  }
  __syncwarp();
}

__device__ inline void SetInBox(WordBox& box, int at, uint64_t mask) {
  atomicOr(&box.words[at], uint32_t(mask));
  if (uint32_t(mask >> 32) != 0) atomicOr(&box.words[at + 1], uint32_t(mask >> 32));
}

}  // namespace voxelpipe::cuda
