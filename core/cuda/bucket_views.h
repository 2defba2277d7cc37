// Buckets of the A-buffer: what kernels get. Plain structs, no host-only includes.
#pragma once

#include <cstdint>

namespace voxelpipe::cuda {

inline constexpr int kBucketThreads = 256, kKeysOfThread = 16, kKeysOfChunk = kBucketThreads * kKeysOfThread;

// Voxels of fragments in 32 bits, sorted, in chunks of kKeysOfChunk.
struct SortedKeys {
  const uint32_t* keys = nullptr;
  uint64_t fragments = 0;
  uint64_t* first = nullptr;  // of chunks: how many voxels begin before it; and one more

  uint64_t chunks() const { return (fragments + kKeysOfChunk - 1) / kKeysOfChunk; }
};

// `Index`: the type of what is listed.
template <typename Index>
struct BucketArgs : SortedKeys {
  uint64_t first_voxel = 0;  // of the slab
  Index *offsets = nullptr, *voxels = nullptr;
};

}  // namespace voxelpipe::cuda
