// Bundles: fragments of one voxel by triangles whose ids follow one another closely, sorted as one. Neighbours in a
// mesh in order share voxels, so there are about a third as many bundles as fragments where triangles are small. Plain
// structs, no host-only includes.
#pragma once

#include <cstdint>

#include "base/host_device.h"
#include "cuda/run/bucket_views.h"

namespace voxelpipe::cuda {

// In 32 bits: the first triangle's id in the lowest `id_bits`, behind it a bit for each of the `followers` next ids,
// whether it has a fragment too.
struct BundleCode {
  static constexpr uint32_t kMaxIdBits = 28, kMaxFollowers = 15;

  uint32_t id_bits = kMaxIdBits, followers = 32 - kMaxIdBits;

  VOXELPIPE_HD uint32_t Triangle(uint32_t code) const { return code & ((1u << id_bits) - 1); }
  VOXELPIPE_HD uint32_t Followers(uint32_t code) const { return code >> id_bits; }
  // The bit of the triangle `after` ids behind the first, 1 to `followers`.
  VOXELPIPE_HD uint32_t Bit(uint32_t after) const { return 1u << (id_bits - 1 + after); }
};

inline constexpr uint64_t kMaxBundledFragments = (uint64_t{1} << 31) - 1;

// EmitBundles: what a warp takes in each of its rounds, what it has room for, bundles and fragments that become such,
// and its blocks on a multiprocessor at once.
inline constexpr uint32_t kBundledTriangles = 64, kBundleRoom = 640;
inline constexpr int kBundleBlocks = 5;

// How an A-buffer's fragments are bundled.
struct BundlePlan {
  BundleCode code;
  uint32_t rounds = 1;  // of EmitBundles
};

// UnpackBundles.
inline constexpr int kBundleThreads = 256, kBundlesOfThread = 8, kBundlesOfChunk = kBundleThreads * kBundlesOfThread;

inline uint64_t ChunksOfBundles(uint64_t bundles) {
  return (bundles + kBundlesOfChunk - 1) / kBundlesOfChunk;
}

// Sorted bundles, which become buckets in chunks of kBundlesOfChunk. `keys` and `first` are theirs; of fragments there
// are kMaxBundledFragments or fewer.
struct BundleArgs : BucketArgs<uint64_t> {
  BundleCode code;
  uint64_t bundles = 0;
  const uint32_t* codes = nullptr;
  uint32_t* triangles = nullptr;  // become the fragments'

  uint64_t chunks() const { return ChunksOfBundles(bundles); }
};

}  // namespace voxelpipe::cuda
