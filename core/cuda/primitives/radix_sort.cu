#include "cuda/primitives/radix_sort.h"

#include <algorithm>

#include <cub/device/device_radix_sort.cuh>

#include "cuda/device/launch.cuh"

namespace voxelpipe::cuda {
namespace {

struct Work {
  uint64_t count;
  int bits;
  DeviceArray<uint8_t>& scratch;
  cudaStream_t stream;
};

// Calls sort(scratch, bytes) to learn how much it needs, and then with that.
template <typename Sort>
absl::Status WithScratch(const Work& work, const Sort& sort) {
  size_t bytes = 0;
  VOXELPIPE_CUDA_OR_RETURN(sort(nullptr, bytes));
  VOXELPIPE_OK_OR_RETURN(work.scratch.Resize(std::max<size_t>(bytes, 1), work.stream));
  VOXELPIPE_CUDA_OR_RETURN(sort(work.scratch.data(), bytes));
  return absl::OkStatus();
}

// Out: the copy that is sorted.
template <typename Key>
absl::StatusOr<int> Sort(const Work& work, const KeyValueArrays& arrays) {
  cub::DoubleBuffer<Key> keys(static_cast<Key*>(arrays.keys[0]), static_cast<Key*>(arrays.keys[1]));
  cub::DoubleBuffer<uint32_t> values(arrays.values[0], arrays.values[1]);
  CountLaunch();
  VOXELPIPE_OK_OR_RETURN(WithScratch(work, [&](void* scratch, size_t& bytes) {
    return cub::DeviceRadixSort::SortPairs(scratch, bytes, keys, values, work.count, 0, work.bits, work.stream);
  }));
  return values.Current() == arrays.values[0] ? 0 : 1;
}

}  // namespace

absl::StatusOr<int> SortByKey(const KeyValueArrays& arrays, const KeySort& sort, DeviceArray<uint8_t>& scratch,
                              cudaStream_t stream) {
  const Work work{arrays.count, sort.bits, scratch, stream};
  return sort.wide_keys ? Sort<uint64_t>(work, arrays) : Sort<uint32_t>(work, arrays);
}

}  // namespace voxelpipe::cuda
