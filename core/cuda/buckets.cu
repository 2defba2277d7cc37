#include "cuda/bucket_kernels.cuh"
#include "cuda/fragments.h"
#include "cuda/scan.h"

namespace voxelpipe::cuda {
namespace {

template <typename Index>
absl::Status List(const BucketArgs<Index>& args, cudaStream_t stream) {
  WriteBuckets<<<unsigned(args.chunks()), kBucketThreads, 0, stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("WriteBuckets");
  return absl::OkStatus();
}

}  // namespace

absl::Status ScanInPlace(uint64_t* sums, uint64_t count, cudaStream_t stream) {
  ScanChunks<<<1, kScanThreads, 0, stream>>>(sums, count);
  VOXELPIPE_LAUNCHED_OR_RETURN("ScanChunks");
  return absl::OkStatus();
}

absl::Status CountBuckets(const SortedKeys& keys, cudaStream_t stream) {
  CountHeads<<<unsigned(keys.chunks()), kBucketThreads, 0, stream>>>(keys);
  VOXELPIPE_LAUNCHED_OR_RETURN("CountHeads");
  return ScanInPlace(keys.first, keys.chunks(), stream);
}

absl::Status ListBuckets(const BucketArgs<uint64_t>& args, cudaStream_t stream) {
  return List(args, stream);
}
absl::Status ListBuckets(const BucketArgs<uint32_t>& args, cudaStream_t stream) {
  return List(args, stream);
}

}  // namespace voxelpipe::cuda
