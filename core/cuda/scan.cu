#include "cuda/scan.h"

#include <cub/device/device_scan.cuh>
#include <cuda/std/functional>

#include <algorithm>

namespace voxelpipe::cuda {

absl::Status ExclusiveScan(RunState& state, const uint32_t* in, uint64_t* out, uint64_t count) {
  if (count == 0) return absl::OkStatus();
  size_t scratch = 0;
  const ::cuda::std::plus<> plus;
  VOXELPIPE_CUDA_OR_RETURN(
      cub::DeviceScan::ExclusiveScan(nullptr, scratch, in, out, plus, uint64_t{0}, count, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.scratch.Resize(std::max<size_t>(scratch, 1), state.stream));
  VOXELPIPE_CUDA_OR_RETURN(
      cub::DeviceScan::ExclusiveScan(state.scratch.data(), scratch, in, out, plus, uint64_t{0}, count, state.stream));
  return absl::OkStatus();
}

absl::StatusOr<uint64_t> ReadElement(RunState& state, const uint64_t* at) {
  uint64_t value = 0;
  VOXELPIPE_CUDA_OR_RETURN(cudaMemcpyAsync(&value, at, sizeof value, cudaMemcpyDeviceToHost, state.stream));
  VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(state.stream));
  return value;
}

}  // namespace voxelpipe::cuda
