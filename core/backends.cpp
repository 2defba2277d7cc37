#include "pipeline/stages/backend.h"

#include <string_view>

#include "cpu/backend.h"
#if defined(VOXELPIPE_HAVE_CUDA)
#include "cuda/backend.h"
#include "cuda/device/mesh_cache.h"
#endif

namespace voxelpipe {
namespace {

std::vector<const Backend*>& Registered() {
  static auto* const devices = new std::vector<const Backend*>;
  return *devices;
}

// The first registered device of this kind; null if there is none.
const Backend* FindRegistered(std::string_view name) {
  for (const Backend* device : Registered()) {
    if (device->name() == name) return device;
  }
  return nullptr;
}

}  // namespace

void RegisterDevice(const Backend* device) {
  Registered().push_back(device);
}

std::vector<const Backend*> Devices() {
  std::vector<const Backend*> devices = Registered();
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
  if (const Backend* const device = FindRegistered("cuda")) return device;
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
