// Fragments of the A-buffer: the voxel and the triangle of each.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "cuda/device/buffer.h"
#include "cuda/device/device.h"
#include "cuda/run/fragment_group.h"

namespace voxelpipe::cuda {

// Two copies, one of which is the current one.
struct Fragments {
  DeviceArray<uint8_t> keys[2];        // voxels: u32, u64 where there are more
  DeviceArray<uint32_t> triangles[2];  // or codes of bundles
  uint64_t count = 0;
  int current = 0;
  std::optional<BundlePlan> plan;  // of bundles, of which the arrays have `bundles`
  uint64_t bundles = 0;

  absl::Status MakeRoom(uint64_t key_bytes, cudaStream_t stream) {
    for (int i = 0; i < 2; ++i) VOXELPIPE_OK_OR_RETURN(MakeRoom(i, count, key_bytes, stream));
    return absl::OkStatus();
  }
  // In one of the copies.
  absl::Status MakeRoom(int copy, uint64_t fragments, uint64_t key_bytes, cudaStream_t stream) {
    VOXELPIPE_OK_OR_RETURN(keys[copy].Resize(fragments * key_bytes, stream));
    return triangles[copy].Resize(fragments, stream);
  }
  void Free() {
    for (auto& array : keys) array.Free();
    for (auto& array : triangles) array.Free();
    Clear();
  }
  // None, and no bundles. The arrays stay.
  void Clear() {
    count = bundles = 0;
    current = 0;
    plan.reset();
  }
  // What is sorted.
  uint64_t elements() const { return plan ? bundles : count; }
  template <typename Key>
  Key* KeysAs(int copy) {
    return reinterpret_cast<Key*>(keys[copy].data());
  }
};

struct KeySort {
  bool wide_keys = false;  // 64 bits, not 32
  int bits = 0;            // the lowest that keys have
};

// Sorts the first copy by its keys; fragments of one key keep their order. What `scratch` had is lost. In
// radix_sort.cu: CUB compiles slowly, so its instances stand in one place.
absl::Status SortByKey(Fragments& fragments, const KeySort& sort, DeviceArray<uint8_t>& scratch, cudaStream_t stream);

// In resolve.cu. Fills keys.first; the last element becomes the number of voxels, for which ListBuckets wants room.
// There are fragments.
absl::Status CountBuckets(const SortedKeys& keys, cudaStream_t stream);
// Both in one, which reads the keys once. keys.first is 0 everywhere, and what it becomes is no other's.
absl::Status CountAndListBuckets(const BucketArgs<uint64_t>& args, cudaStream_t stream);
// Buckets of bundles, and their fragments, which are read once. keys.first as above.
absl::Status UnpackIntoBuckets(const BundleArgs& args, cudaStream_t stream);
// Voxels and where their fragments begin; behind the last one's stands the number of all fragments.
absl::Status ListBuckets(const BucketArgs<uint32_t>& args, cudaStream_t stream);

}  // namespace voxelpipe::cuda
