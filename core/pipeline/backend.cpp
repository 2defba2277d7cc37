#include "pipeline/backend.h"

#include "cpu/backend.h"
#if defined(VOXELPIPE_HAVE_CUDA)
#include "cuda/backend.h"
#include "cuda/mesh_cache.h"
#endif

namespace voxelpipe {

std::vector<std::string> AvailableBackends() {
  std::vector<std::string> names;
#if defined(VOXELPIPE_HAVE_CUDA)
  if (cuda::FirstCudaBackend().ok()) names.emplace_back("cuda");
#endif
  names.emplace_back(cpu::CpuBackend().name());
  return names;
}

std::vector<const Backend*> Devices() {
  std::vector<const Backend*> devices;
#if defined(VOXELPIPE_HAVE_CUDA)
  for (const Backend* device : cuda::CudaBackends()) devices.push_back(device);
#endif
  devices.push_back(&cpu::CpuBackend());
  return devices;
}

#if defined(VOXELPIPE_HAVE_CUDA)
void SetDeviceMeshBytes(uint64_t bytes) {
  cuda::SetMeshCacheBytes(bytes);
}
#else
void SetDeviceMeshBytes(uint64_t /*bytes*/) {}
#endif

absl::StatusOr<const Backend*> SelectBackend(BackendChoice choice) {
  if (choice == BackendChoice::kCpu) return &cpu::CpuBackend();
#if defined(VOXELPIPE_HAVE_CUDA)
  absl::StatusOr<const Backend*> device = cuda::FirstCudaBackend();
  if (device.ok() || choice == BackendChoice::kCuda) return device;
#else
  if (choice == BackendChoice::kCuda) {
    return absl::FailedPreconditionError("backend: this build has no CUDA backend");
  }
#endif
  return &cpu::CpuBackend();
}

}  // namespace voxelpipe
