// Queries compiled architectures and cache sizes. A .cu file, because it queries a kernel of its own.
#include "cuda/device/device_caps.h"

#include <cuda_runtime_api.h>

#include <algorithm>

namespace voxelpipe::cuda {
namespace {

__global__ void Compiled() {}  // compiled for the same architectures as all kernels

}  // namespace

bool BeginsEarly(const DeviceInfo& device) {
  static std::array<std::atomic<int>, 64> known{};
  return OfDevice(known, device, [&] {
           cudaFuncAttributes compiled{};
           if (cudaFuncGetAttributes(&compiled, Compiled) != cudaSuccess) (void)cudaGetLastError();
           return compiled.ptxVersion >= 90 ? 1 : 0;
         }) != 0;
}

bool ExceedsCache(const DeviceInfo& device, uint64_t bytes) {
  static std::array<std::atomic<int>, 64> known{};
  if (const uint64_t assumed = AssumedCache(); assumed > 0) return bytes > assumed / 2;
  const int cache = OfDevice(known, device, [&] {
    int size = 0;
    if (cudaDeviceGetAttribute(&size, cudaDevAttrL2CacheSize, device.ordinal) != cudaSuccess) size = 0;
    return std::max(size, 0);
  });
  return cache != 0 && bytes > uint64_t(cache) / 2;
}

}  // namespace voxelpipe::cuda
