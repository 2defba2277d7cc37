#include <cub/device/device_radix_sort.cuh>

#include <algorithm>

#include "cuda/device/device_caps.h"
#include "cuda/device/launch.cuh"
#include "cuda/run/fragment_list.h"

namespace voxelpipe::cuda {
namespace {

struct Work {
  uint64_t count;
  int bits;
  DeviceArray<uint8_t>& scratch;
  cudaStream_t stream;
};

template <typename Key>
struct Buffers {
  cub::DoubleBuffer<Key> keys;
  cub::DoubleBuffer<uint32_t> values;
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

template <typename Key>
absl::Status Sort(const Work& work, Buffers<Key>& buffers) {
  CountLaunch();
  return WithScratch(work, [&](void* scratch, size_t& bytes) {
    return cub::DeviceRadixSort::SortPairs(scratch, bytes, buffers.keys, buffers.values, work.count, 0, work.bits,
                                           work.stream);
  });
}

template <typename Key>
Buffers<Key> BuffersOf(Fragments& fragments) {
  return {cub::DoubleBuffer<Key>(fragments.KeysAs<Key>(0), fragments.KeysAs<Key>(1)),
          cub::DoubleBuffer<uint32_t>(fragments.triangles[0].data(), fragments.triangles[1].data())};
}

}  // namespace

absl::Status SortByKey(Fragments& fragments, const KeySort& sort, DeviceArray<uint8_t>& scratch, cudaStream_t stream) {
  const Work work{fragments.elements(), sort.bits, scratch, stream};
  uint32_t* sorted = nullptr;
  if (sort.wide_keys) {
    Buffers<uint64_t> buffers = BuffersOf<uint64_t>(fragments);
    VOXELPIPE_OK_OR_RETURN(Sort(work, buffers));
    sorted = buffers.values.Current();
  } else {
    Buffers<uint32_t> buffers = BuffersOf<uint32_t>(fragments);
    VOXELPIPE_OK_OR_RETURN(Sort(work, buffers));
    sorted = buffers.values.Current();
  }
  fragments.current = sorted == fragments.triangles[0].data() ? 0 : 1;
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
