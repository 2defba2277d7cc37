// Launches of the kernels that convert sorted fragments to buckets.
#include "cuda/a_buffer/resolve.h"

#include "cuda/a_buffer/resolve_kernels.cuh"
#include "cuda/a_buffer/unpack_groups.cuh"
#include "cuda/device/check.h"

namespace voxelpipe::cuda {
namespace {

template <bool kCounts, typename Index>
absl::Status List(const BucketArgs<Index>& args, cudaStream_t stream) {
  WriteBuckets<kCounts><<<unsigned(args.chunks()), kBucketThreads, 0, stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("WriteBuckets");
  return absl::OkStatus();
}

}  // namespace

absl::Status CountBuckets(const SortedKeys& keys, cudaStream_t stream) {
  CountHeads<<<unsigned(keys.chunks()), kBucketThreads, 0, stream>>>(keys);
  VOXELPIPE_LAUNCHED_OR_RETURN("CountHeads");
  ScanChunks<<<1, kScanThreads, 0, stream>>>(keys.first, keys.chunks());
  VOXELPIPE_LAUNCHED_OR_RETURN("ScanChunks");
  return absl::OkStatus();
}

absl::Status CountAndListBuckets(const BucketArgs<uint64_t>& args, cudaStream_t stream) {
  return List<true>(args, stream);
}
absl::Status ListBuckets(const BucketArgs<uint32_t>& args, cudaStream_t stream) {
  return List<false>(args, stream);
}
absl::Status UnpackIntoBuckets(const BundleArgs& args, cudaStream_t stream) {
  UnpackBundles<<<unsigned(args.chunks()), kBundleThreads, 0, stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("UnpackBundles");
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
