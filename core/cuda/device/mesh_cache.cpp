// The least-recently-used cache of mesh arrays, one per device.
#include "cuda/device/mesh_cache.h"

#include <atomic>
#include <list>
#include <map>
#include <mutex>
#include <unordered_map>
#include <utility>

#include "cuda/device/mesh_uploads.h"

namespace voxelpipe::cuda {
namespace {

constexpr uint64_t kQuarter = UINT64_MAX;  // default: a quarter of the device's memory
std::atomic<uint64_t> most_bytes{kQuarter};

// The cache of one device.
class Cache {
 public:
  std::shared_ptr<const CachedArray> Find(const std::string& key, uint64_t bytes) {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    if (found == entries_.end() || found->second->array->bytes() != bytes) {
      ++use_.misses;
      return nullptr;
    }
    ++use_.hits;
    order_.splice(order_.begin(), order_, found->second);
    return found->second->array;
  }

  void Keep(const std::string& key, std::shared_ptr<const CachedArray> array, uint64_t most, Keeping keeping) {
    Order gone;  // destroyed after the lock is released
    const std::lock_guard lock(mutex_);
    if (keeping == Keeping::kIfRoom && use_.bytes + array->bytes() > most) return;
    const auto old = entries_.find(key);
    if (old != entries_.end()) Drop(old->second, gone);
    use_.bytes += array->bytes();
    order_.push_front({key, std::move(array)});
    entries_[key] = order_.begin();
    while (use_.bytes > most && !order_.empty()) Drop(std::prev(order_.end()), gone);
  }

  uint64_t Clear() {
    Order gone;
    const std::lock_guard lock(mutex_);
    const uint64_t bytes = use_.bytes;
    while (!order_.empty()) Drop(std::prev(order_.end()), gone);
    return bytes;
  }

  MeshCacheUse Use() {
    const std::lock_guard lock(mutex_);
    MeshCacheUse use = use_;
    use.arrays = entries_.size();
    return use;
  }

 private:
  struct Entry {
    std::string key;
    std::shared_ptr<const CachedArray> array;
  };
  using Order = std::list<Entry>;  // most recently used first

  void Drop(Order::iterator entry, Order& gone) {
    use_.bytes -= entry->array->bytes();
    entries_.erase(entry->key);
    gone.splice(gone.end(), order_, entry);
  }

  std::mutex mutex_;
  Order order_;
  std::unordered_map<std::string, Order::iterator> entries_;
  MeshCacheUse use_;
};

Cache& CacheOf(int ordinal) {
  static std::mutex mutex;
  static auto* const caches = new std::map<int, Cache>;  // never destroyed: the device may be gone by then
  const std::lock_guard lock(mutex);
  return (*caches)[ordinal];
}

}  // namespace

uint64_t MeshCacheBytes(int ordinal) {
  const uint64_t most = most_bytes.load();
  if (most != kQuarter) return most;
  static std::mutex mutex;
  static auto* const quarters = new std::map<int, uint64_t>;
  const std::lock_guard lock(mutex);
  uint64_t& quarter = (*quarters)[ordinal];
  if (quarter == 0) {
    size_t free = 0, all = 0;
    if (cudaMemGetInfo(&free, &all) != cudaSuccess) (void)cudaGetLastError();
    quarter = all / 4;
  }
  return quarter;
}

absl::StatusOr<std::shared_ptr<const CachedArray>> CachedMade(int ordinal, const std::string& key, uint64_t bytes,
                                                              cudaStream_t stream,
                                                              const std::function<absl::Status(uint8_t*)>& make,
                                                              Keeping keeping) {
  Cache& cache = CacheOf(ordinal);
  if (std::shared_ptr<const CachedArray> found = cache.Find(key, bytes)) {
    VOXELPIPE_CUDA_OR_RETURN(cudaStreamWaitEvent(stream, found->ready_, 0));
    return found;
  }
  auto made = std::make_shared<CachedArray>();
  {
    const ApartFromRuns apart;
    VOXELPIPE_OK_OR_RETURN(made->array_.Resize(bytes, stream));
  }
  VOXELPIPE_OK_OR_RETURN(make(made->array_.data()));
  VOXELPIPE_CUDA_OR_RETURN(cudaEventCreateWithFlags(&made->ready_, cudaEventDisableTiming));
  VOXELPIPE_CUDA_OR_RETURN(cudaEventRecord(made->ready_, stream));
  const uint64_t most = MeshCacheBytes(ordinal);
  if (bytes <= most) cache.Keep(key, made, most, keeping);
  return std::shared_ptr<const CachedArray>(std::move(made));
}

absl::StatusOr<std::shared_ptr<const CachedArray>> CachedUpload(int ordinal, const std::string& key, const void* from,
                                                                uint64_t bytes, cudaStream_t stream,
                                                                std::vector<PinnedBuffer>& staged) {
  return CachedMade(ordinal, key, bytes, stream, [&](uint8_t* there) {
    CountMeshUpload(ordinal, bytes);
    return StagedCopy(there, from, bytes, stream, staged);
  });
}

void SetMeshCacheBytes(uint64_t bytes) {
  most_bytes = bytes;
}

uint64_t DropCachedMeshes(int ordinal) {
  return CacheOf(ordinal).Clear();
}

MeshCacheUse MeshCacheInUse(int ordinal) {
  return CacheOf(ordinal).Use();
}

}  // namespace voxelpipe::cuda
