// Cache of mesh arrays in device memory that outlives runs.
//
// A mesh with a content id (mesh/triangle_mesh.h) is uploaded once. Its arrays stay cached, with least-recently-used
// eviction, and later runs on the same device use them.
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
  kAlways,  // evicts other entries
  kIfRoom,  // for arrays derived from cached ones: never evicts
};

// An array on the device. Holders release it when their work on it is done.
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
  cudaEvent_t ready_ = nullptr;  // recorded after the upload
};

// Returns the array cached under `key` on the current device. If it is missing, `make` queues the copies or kernels
// that produce it on `stream`. Work queued on `stream` afterwards sees it. The returned pointer must live until that
// work is done.
absl::StatusOr<std::shared_ptr<const CachedArray>> CachedMade(int ordinal, const std::string& key, uint64_t bytes,
                                                              cudaStream_t stream,
                                                              const std::function<absl::Status(uint8_t*)>& make,
                                                              Keeping keeping = Keeping::kAlways);

// The same for one host array. `staged` and the returned pointer must live until the stream's work is done.
absl::StatusOr<std::shared_ptr<const CachedArray>> CachedUpload(int ordinal, const std::string& key, const void* from,
                                                                uint64_t bytes, cudaStream_t stream,
                                                                std::vector<PinnedBuffer>& staged);

// Maximum bytes cached per device; 0 disables the cache. Default: a quarter of the device's memory.
void SetMeshCacheBytes(uint64_t bytes);

// That maximum.
uint64_t MeshCacheBytes(int ordinal);

// Drops arrays that no run holds. Returns the bytes freed.
uint64_t DropCachedMeshes(int ordinal);

struct MeshCacheUse {
  uint64_t bytes = 0, arrays = 0, hits = 0, misses = 0;
};
MeshCacheUse MeshCacheInUse(int ordinal);

}  // namespace voxelpipe::cuda
