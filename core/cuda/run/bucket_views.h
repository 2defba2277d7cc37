// Kernel arguments for the buckets of the A-buffer. Plain structs, no host-only includes.
#pragma once

#include <cstdint>

#include "base/host_device.h"
#include "cuda/primitives/views.h"

namespace voxelpipe::cuda {

inline constexpr int kBucketThreads = 512, kKeysOfThread = 16, kKeysOfChunk = kBucketThreads * kKeysOfThread;

inline uint64_t ChunksOf(uint64_t fragments) {
  return (fragments + kKeysOfChunk - 1) / kKeysOfChunk;
}

// Sorted 32-bit voxel indices of fragments, processed in chunks of kKeysOfChunk.
struct SortedKeys {
  const uint32_t* keys = nullptr;
  uint64_t fragments = 0;
  // Per chunk: number of voxels that begin before it; one more element with the total, except for CountAndListBuckets.
  uint64_t* first = nullptr;

  uint64_t chunks() const { return ChunksOf(fragments); }
};

// `Index`: the type of the listed offsets and voxels.
template <typename Index>
struct BucketArgs : SortedKeys {
  uint64_t first_voxel = 0;  // of the slab
  Index *offsets = nullptr, *voxels = nullptr;
  // For CountAndListBuckets only.
  uint64_t* listed = nullptr;  // receives the number of voxels
  // Bit arrays to set to 1 for all fragments: targets whose shaders need not run. Whole words.
  uint32_t* ones[kMaxTargets] = {};
  int ones_count = 0;
};

// Word `word` of a bit array whose first `bits` bits are set.
VOXELPIPE_HD uint32_t WordOfOnes(uint64_t bits, uint64_t word) {
  return bits - word * 32 >= 32 ? ~0u : (1u << (bits - word * 32)) - 1;
}

}  // namespace voxelpipe::cuda
