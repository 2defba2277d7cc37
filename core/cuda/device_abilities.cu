#include "cuda/device_abilities.h"

#include <cuda_runtime_api.h>

#include <algorithm>

namespace voxelpipe::cuda {
namespace {

__global__ void Compiled() {}  // as all kernels are

}  // namespace

bool BeginsEarly(const DeviceInfo& device) {
  static std::array<std::atomic<int>, 64> known{};
  return OfDevice(known, device, [&] {
           cudaFuncAttributes compiled{};
           if (cudaFuncGetAttributes(&compiled, Compiled) != cudaSuccess) (void)cudaGetLastError();
           return compiled.ptxVersion >= 90 ? 1 : 0;
         }) != 0;
}

int CacheBytes(const DeviceInfo& device) {
  static std::array<std::atomic<int>, 64> known{};
  return OfDevice(known, device, [&] {
    int bytes = 0;
    if (cudaDeviceGetAttribute(&bytes, cudaDevAttrL2CacheSize, device.ordinal) != cudaSuccess) bytes = 0;
    return std::max(bytes, 0);
  });
}

}  // namespace voxelpipe::cuda
