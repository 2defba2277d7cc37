// The A-buffer's list of fragments: voxel and triangle of each.
#pragma once

#include <cstdint>
#include <optional>

#include "cuda/device/buffer.h"
#include "cuda/primitives/radix_sort.h"
#include "cuda/run/fragment_group.h"

namespace voxelpipe::cuda {

// Double-buffered for sorting; `current` is the valid copy.
struct Fragments {
  DeviceArray<uint32_t> keys[2];       // voxel indices
  DeviceArray<uint32_t> triangles[2];  // or codes of groups (fragment_group.h)
  uint64_t count = 0;
  int current = 0;
  std::optional<BundlePlan> plan;  // set if fragments are grouped; the arrays then have `bundles` elements
  uint64_t bundles = 0;

  absl::Status MakeRoom(cudaStream_t stream) {
    for (int i = 0; i < 2; ++i) VOXELPIPE_OK_OR_RETURN(MakeRoom(i, count, stream));
    return absl::OkStatus();
  }
  // Resizes one of the copies.
  absl::Status MakeRoom(int copy, uint64_t fragments, cudaStream_t stream) {
    VOXELPIPE_OK_OR_RETURN(keys[copy].Resize(fragments, stream));
    return triangles[copy].Resize(fragments, stream);
  }
  void Free() {
    for (auto& array : keys) array.Free();
    for (auto& array : triangles) array.Free();
    Clear();
  }
  // Removes all fragments and groups. Keeps the arrays allocated.
  void Clear() {
    count = bundles = 0;
    current = 0;
    plan.reset();
  }
  // Number of elements to sort.
  uint64_t elements() const { return plan ? bundles : count; }
};

// Stably sorts the first copy by the lowest `bits` bits of its keys. Overwrites `scratch`.
inline absl::Status SortFragmentList(Fragments& fragments, int bits, DeviceArray<uint8_t>& scratch,
                                     cudaStream_t stream) {
  KeyValueArrays arrays;
  for (int i = 0; i < 2; ++i) {
    arrays.keys[i] = fragments.keys[i].data();
    arrays.values[i] = fragments.triangles[i].data();
  }
  arrays.count = fragments.elements();
  const absl::StatusOr<int> sorted = SortByKey(arrays, bits, scratch, stream);
  if (!sorted.ok()) return sorted.status();
  fragments.current = *sorted;
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
