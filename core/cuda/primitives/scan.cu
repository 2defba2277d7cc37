// The only translation unit that instantiates CUB's prefix sum of 32-bit counts.
#include "cuda/primitives/scan.h"

#include <cub/device/device_scan.cuh>
#include <cuda/std/functional>

#include <algorithm>

namespace voxelpipe::cuda {

absl::Status ExclusiveScan(const uint32_t* in, uint64_t* out, uint64_t count, DeviceArray<uint8_t>& scratch,
                           cudaStream_t stream) {
  if (count == 0) return absl::OkStatus();
  size_t bytes = 0;
  const ::cuda::std::plus<> plus;
  VOXELPIPE_CUDA_OR_RETURN(cub::DeviceScan::ExclusiveScan(nullptr, bytes, in, out, plus, uint64_t{0}, count, stream));
  VOXELPIPE_OK_OR_RETURN(scratch.Resize(std::max<size_t>(bytes, 1), stream));
  VOXELPIPE_CUDA_OR_RETURN(
      cub::DeviceScan::ExclusiveScan(scratch.data(), bytes, in, out, plus, uint64_t{0}, count, stream));
  CountLaunch();
  return absl::OkStatus();
}

absl::StatusOr<uint64_t> ReadElement(const uint64_t* at, cudaStream_t stream) {
  uint64_t value = 0;
  VOXELPIPE_CUDA_OR_RETURN(cudaMemcpyAsync(&value, at, sizeof value, cudaMemcpyDeviceToHost, stream));
  VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(stream));
  return value;
}

}  // namespace voxelpipe::cuda
