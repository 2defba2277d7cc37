// Arrays of meshes that stay on a device between runs.
//
// A mesh that has a content id (mesh/triangle_mesh.h) goes up once: what a run was given of it is kept, the least
// recently used first to go, and later runs on the same device find it there.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "cuda/device/buffer.h"
#include "cuda/device/pinned.h"
#include "cuda/device/run_memory.h"

namespace voxelpipe::cuda {

enum class Keeping {
  kAlways,  // others go for it
  kIfRoom,  // what is made from kept arrays: it does not push them out
};

// An array on the device. Whoever holds one gives it back when the work on it is done.
class CachedArray {
 public:
  CachedArray() = default;
  CachedArray(const CachedArray&) = delete;
  CachedArray& operator=(const CachedArray&) = delete;
  ~CachedArray() {
    const ApartFromRuns apart;
    array_.Free();
    if (ready_ != nullptr) (void)cudaEventDestroy(ready_);
  }
  const uint8_t* data() const { return array_.data(); }
  uint64_t bytes() const { return array_.size(); }

 private:
  friend absl::StatusOr<std::shared_ptr<const CachedArray>> CachedMade(
      int ordinal, const std::string& key, uint64_t bytes, cudaStream_t stream,
      const std::function<absl::Status(uint8_t*)>& make, Keeping keeping);
  DeviceArray<uint8_t> array_;
  cudaEvent_t ready_ = nullptr;  // when the upload is done
};

// The array that `key` names on the device, which is the current one; where it is not there, `make` gives `stream` the
// copies from the host, or the kernels, that make it. Work given to `stream` afterwards finds it. The returned pointer
// must live until that work is done.
absl::StatusOr<std::shared_ptr<const CachedArray>> CachedMade(int ordinal, const std::string& key, uint64_t bytes,
                                                              cudaStream_t stream,
                                                              const std::function<absl::Status(uint8_t*)>& make,
                                                              Keeping keeping = Keeping::kAlways);

// The same for one array of the host. What stands in `staged` must live until the stream's work is done, and so must
// the returned pointer.
absl::StatusOr<std::shared_ptr<const CachedArray>> CachedUpload(int ordinal, const std::string& key, const void* from,
                                                                uint64_t bytes, cudaStream_t stream,
                                                                std::vector<PinnedBuffer>& staged);

// Most bytes kept on each device; 0 keeps nothing. By default a quarter of the device's memory.
void SetMeshCacheBytes(uint64_t bytes);

// Forgets what no run holds; bytes freed.
uint64_t DropCachedMeshes(int ordinal);

struct MeshCacheUse {
  uint64_t bytes = 0, arrays = 0, hits = 0, misses = 0;
};
MeshCacheUse MeshCacheInUse(int ordinal);

}  // namespace voxelpipe::cuda
