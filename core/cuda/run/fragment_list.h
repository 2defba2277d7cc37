// Fragments of the A-buffer: the voxel and the triangle of each.
#pragma once

#include <cstdint>
#include <optional>

#include "cuda/device/buffer.h"
#include "cuda/primitives/radix_sort.h"
#include "cuda/run/fragment_group.h"

namespace voxelpipe::cuda {

// Two copies, one of which is the current one.
struct Fragments {
  DeviceArray<uint32_t> keys[2];       // voxels
  DeviceArray<uint32_t> triangles[2];  // or codes of bundles
  uint64_t count = 0;
  int current = 0;
  std::optional<BundlePlan> plan;  // of bundles, of which the arrays have `bundles`
  uint64_t bundles = 0;

  absl::Status MakeRoom(cudaStream_t stream) {
    for (int i = 0; i < 2; ++i) VOXELPIPE_OK_OR_RETURN(MakeRoom(i, count, stream));
    return absl::OkStatus();
  }
  // In one of the copies.
  absl::Status MakeRoom(int copy, uint64_t fragments, cudaStream_t stream) {
    VOXELPIPE_OK_OR_RETURN(keys[copy].Resize(fragments, stream));
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
};

// Sorts the first copy by the lowest `bits` bits of its keys; fragments of one key keep their order. What `scratch` had is lost.
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
