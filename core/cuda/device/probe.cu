// Self-test that a device must pass before it gets work.
#include <vector>

#include "base/host_device.h"
#include "cuda/device/buffer.h"
#include "cuda/device/device.h"

namespace voxelpipe::cuda {
namespace {

constexpr uint32_t kWords = 1 << 12, kThreads = 128;

VOXELPIPE_HD uint32_t Mixed(uint32_t i) {
  return i * 2654435761u ^ i >> 7;
}

__global__ void __launch_bounds__(kThreads) WriteWords(uint32_t* to) {
  const uint32_t i = blockIdx.x * kThreads + threadIdx.x;
  if (i < kWords) to[i] = Mixed(i);
}

}  // namespace

absl::Status RunProbe(cudaStream_t stream) {
  DeviceArray<uint32_t> words;
  VOXELPIPE_OK_OR_RETURN(words.Resize(kWords, stream));
  VOXELPIPE_OK_OR_RETURN(words.Fill(0, stream));
  WriteWords<<<kWords / kThreads, kThreads, 0, stream>>>(words.data());
  VOXELPIPE_LAUNCHED_OR_RETURN("WriteWords");
  std::vector<uint32_t> back(kWords);
  VOXELPIPE_CUDA_OR_RETURN(cudaMemcpyAsync(back.data(), words.data(), words.bytes(), cudaMemcpyDeviceToHost, stream));
  VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(stream));
  for (uint32_t i = 0; i < kWords; ++i) {
    if (back[i] != Mixed(i)) return absl::InternalError("the device wrote something else than it was to");
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
