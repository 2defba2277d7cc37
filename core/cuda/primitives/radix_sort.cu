// The only translation unit that instantiates CUB's radix sort of key-value pairs.
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

}  // namespace voxelpipe::cuda
