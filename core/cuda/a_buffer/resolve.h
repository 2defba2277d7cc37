// Sorted fragments become buckets: the launchers of resolve.cu.
#pragma once

#include "cuda/device/buffer.h"
#include "cuda/run/fragment_group.h"

namespace voxelpipe::cuda {

// Fills keys.first; the last element becomes the number of voxels, for which ListBuckets wants room.
// There are fragments.
absl::Status CountBuckets(const SortedKeys& keys, cudaStream_t stream);
// Both in one, which reads the keys once. keys.first is 0 everywhere, and what it becomes is no other's.
absl::Status CountAndListBuckets(const BucketArgs<uint64_t>& args, cudaStream_t stream);
// Buckets of bundles, and their fragments, which are read once. keys.first as above.
absl::Status UnpackIntoBuckets(const BundleArgs& args, cudaStream_t stream);
// Voxels and where their fragments begin; behind the last one's stands the number of all fragments.
absl::Status ListBuckets(const BucketArgs<uint32_t>& args, cudaStream_t stream);

}  // namespace voxelpipe::cuda
