// Fragment groups ("bundles" in the code): fragments of one voxel by triangles with nearby ids, sorted as one element.
// Neighbours in a mesh with good locality share voxels, so small triangles make about a third as many groups as
// fragments. Plain structs, no host-only includes.
#pragma once

#include <cstdint>

#include "base/host_device.h"
#include "cuda/run/bucket_views.h"

namespace voxelpipe::cuda {

// 32-bit code of a group: the first triangle's id in the lowest `id_bits`, then one bit for each of the next
// `followers` ids, set if that triangle has a fragment too.
struct BundleCode {
  static constexpr uint32_t kMaxIdBits = 28, kMaxFollowers = 15;

  uint32_t id_bits = kMaxIdBits, followers = 32 - kMaxIdBits;

  VOXELPIPE_HD uint32_t Triangle(uint32_t code) const { return code & ((1u << id_bits) - 1); }
  VOXELPIPE_HD uint32_t Followers(uint32_t code) const { return code >> id_bits; }
  // The bit of triangle `after` ids behind the first, 1 to `followers`.
  VOXELPIPE_HD uint32_t Bit(uint32_t after) const { return 1u << (id_bits - 1 + after); }
};

inline constexpr uint64_t kMaxBundledFragments = (uint64_t{1} << 31) - 1;

// EmitBundles: triangles per warp and iteration, shared-memory capacity of a warp (groups, and fragments not grouped
// yet), and resident blocks per multiprocessor.
inline constexpr uint32_t kBundledTriangles = 64, kBundleRoom = 640;
inline constexpr int kBundleBlocks = 5;

// Parameters of grouping for one A-buffer.
struct BundlePlan {
  BundleCode code;
  uint32_t rounds = 1;  // iterations of a warp of EmitBundles
};

// Launch parameters of UnpackBundles.
inline constexpr int kBundleThreads = 256, kBundlesOfThread = 8, kBundlesOfChunk = kBundleThreads * kBundlesOfThread;

inline uint64_t ChunksOfBundles(uint64_t bundles) {
  return (bundles + kBundlesOfChunk - 1) / kBundlesOfChunk;
}

// Sorted groups, which become buckets in chunks of kBundlesOfChunk. `keys` and `first` are per group. There are at most
// kMaxBundledFragments fragments.
struct BundleArgs : BucketArgs<uint64_t> {
  BundleCode code;
  uint64_t bundles = 0;
  const uint32_t* codes = nullptr;
  uint32_t* triangles = nullptr;  // output: triangle of each fragment

  uint64_t chunks() const { return ChunksOfBundles(bundles); }
};

}  // namespace voxelpipe::cuda
