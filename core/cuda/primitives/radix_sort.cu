// The only translation unit that instantiates CUB's radix sorts.
#include "cuda/primitives/radix_sort.h"

#include <algorithm>

#include <cub/device/device_radix_sort.cuh>

#include "cuda/device/launch.cuh"

namespace voxelpipe::cuda {

absl::StatusOr<int> SortByKey(const KeyValueArrays& arrays, int bits, DeviceArray<uint8_t>& scratch,
                              cudaStream_t stream) {
  cub::DoubleBuffer<uint32_t> keys(arrays.keys[0], arrays.keys[1]), values(arrays.values[0], arrays.values[1]);
  const auto sort = [&](void* room, size_t& bytes) {
    return cub::DeviceRadixSort::SortPairs(room, bytes, keys, values, arrays.count, 0, bits, stream);
  };
  size_t bytes = 0;
  VOXELPIPE_CUDA_OR_RETURN(sort(nullptr, bytes));
  VOXELPIPE_OK_OR_RETURN(scratch.Resize(std::max<size_t>(bytes, 1), stream));
  CountLaunch();
  VOXELPIPE_CUDA_OR_RETURN(sort(scratch.data(), bytes));
  return values.Current() == arrays.values[0] ? 0 : 1;
}

absl::StatusOr<int> SortKeys(const std::array<uint64_t*, 2>& keys, uint64_t count, int begin_bit, int end_bit,
                             DeviceArray<uint8_t>& scratch, cudaStream_t stream) {
  cub::DoubleBuffer<uint64_t> buffers(keys[0], keys[1]);
  const auto sort = [&](void* room, size_t& bytes) {
    return cub::DeviceRadixSort::SortKeys(room, bytes, buffers, count, begin_bit, end_bit, stream);
  };
  size_t bytes = 0;
  VOXELPIPE_CUDA_OR_RETURN(sort(nullptr, bytes));
  VOXELPIPE_OK_OR_RETURN(scratch.Resize(std::max<size_t>(bytes, 1), stream));
  CountLaunch();
  VOXELPIPE_CUDA_OR_RETURN(sort(scratch.data(), bytes));
  return buffers.Current() == keys[0] ? 0 : 1;
}

}  // namespace voxelpipe::cuda
