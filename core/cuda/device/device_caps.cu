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

uint64_t CacheBytes(const DeviceInfo& device) {
  static std::array<std::atomic<int>, 64> known{};
  if (const uint64_t assumed = AssumedCache(); assumed > 0) return assumed;
  return uint64_t(OfDevice(known, device, [&] {
    int size = 0;
    if (cudaDeviceGetAttribute(&size, cudaDevAttrL2CacheSize, device.ordinal) != cudaSuccess) size = 0;
    return std::max(size, 0);
  }));
}

bool ExceedsCache(const DeviceInfo& device, uint64_t bytes) {
  const uint64_t cache = CacheBytes(device);
  return cache != 0 && bytes > cache / 2;
}

}  // namespace voxelpipe::cuda
