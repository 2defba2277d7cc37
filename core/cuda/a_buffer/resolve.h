// Launches the kernels that convert sorted fragments to buckets (resolve.cu).
#pragma once

#include "cuda/device/buffer.h"
#include "cuda/run/fragment_group.h"

namespace voxelpipe::cuda {

// Fills keys.first; its last element receives the number of voxels, the output size of ListBuckets. There must be
// fragments.
absl::Status CountBuckets(const SortedKeys& keys, cudaStream_t stream);
// Counts and lists in one pass over the keys. keys.first must be 0 everywhere; its contents afterwards are internal.
absl::Status CountAndListBuckets(const BucketArgs<uint64_t>& args, cudaStream_t stream);
// Makes the buckets of groups and unpacks their fragments in one pass. keys.first as above.
absl::Status UnpackIntoBuckets(const BundleArgs& args, cudaStream_t stream);
// Lists voxels and the offsets of their fragments, followed by the number of all fragments.
absl::Status ListBuckets(const BucketArgs<uint32_t>& args, cudaStream_t stream);

}  // namespace voxelpipe::cuda
