#include <cub/device/device_radix_sort.cuh>

#include <algorithm>

#include "cuda/device_abilities.h"
#include "cuda/fragments.h"
#include "cuda/launch.h"

// What goes beyond CUB's interface is for these versions; with others keys are sorted as CUB has it.
#if defined(CUB_VERSION) && CUB_VERSION >= 300000 && CUB_VERSION < 300100
#define VOXELPIPE_TUNES_CUB
namespace cub::detail {

// The lanes that have a lane's digit of 8 bits, in blocks of 16 warps: by the instruction for that, which takes the longer the more digits a
// warp has, where CUB takes a vote for each bit.
template <>
struct warp_in_block_matcher_t<8, 0, 15> {
  static __device__ __forceinline__ uint32_t match_any(uint32_t digit, uint32_t) {
    return __match_any_sync(~0u, digit);
  }
};

}  // namespace cub::detail

#include "cuda/radix_passes.cuh"
#endif

namespace voxelpipe::cuda {
namespace {

struct Work {
  uint64_t count;
  int bits;
  bool scattered;
  const std::function<absl::Status()>& beside;
  const DeviceInfo& device;
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
  if (work.beside) VOXELPIPE_OK_OR_RETURN(work.beside());
  CountLaunch();
  return WithScratch(work, [&](void* scratch, size_t& bytes) {
    return cub::DeviceRadixSort::SortPairs(scratch, bytes, buffers.keys, buffers.values, work.count, 0, work.bits,
                                           work.stream);
  });
}

// CUB sorts 8 bits a pass. Keys of 25 to 27 bits go in three passes of 9 bits, which takes less than four; with 10 bits, for 30, each
// pass took longer than it saved.
#ifdef VOXELPIPE_TUNES_CUB
template <typename D>
absl::Status SortByDigits(const Work& work, Buffers<uint32_t>& buffers) {
  const auto count = uint32_t(work.count);
  const uint64_t passes = uint64_t((work.bits + D::kOfDigit - 1) / D::kOfDigit), tiles = D::TilesOf(count);
  const uint64_t starts = passes * D::kCount, said = tiles * starts, quads = (starts + said + passes + 3) / 4;
  VOXELPIPE_OK_OR_RETURN(work.scratch.Resize(quads * sizeof(uint4), work.stream));
  RadixRoom room;
  room.starts = reinterpret_cast<uint32_t*>(work.scratch.data());
  room.said = reinterpret_cast<int*>(room.starts + starts);
  room.taken = room.said + said;
  const bool early = BeginsEarly(work.device);
  const auto processors = unsigned(work.device.multiprocessors);
  LaunchEarly(early, work.stream, BlocksFor(quads, 256, processors * 8), 256, ClearRadixRoom,
              reinterpret_cast<uint4*>(work.scratch.data()), quads);
  VOXELPIPE_LAUNCHED_OR_RETURN("ClearRadixRoom");
  LaunchEarly(early, work.stream, BlocksFor(count, D::kCountThreads, processors * D::kCountBlocks), D::kCountThreads,
              CountDigits<D>, static_cast<const uint32_t*>(buffers.keys.Current()), count, work.bits, room.starts);
  VOXELPIPE_LAUNCHED_OR_RETURN("CountDigits");
  LaunchEarly(early, work.stream, unsigned(passes), D::kCount, SumDigits<D>, room.starts);
  VOXELPIPE_LAUNCHED_OR_RETURN("SumDigits");
  if (work.beside) VOXELPIPE_OK_OR_RETURN(work.beside());
  for (int pass = 0; pass < int(passes); ++pass) {
    const int bits = std::min(D::kOfDigit, work.bits - pass * D::kOfDigit);
    LaunchEarly(early, work.stream, unsigned(tiles), D::kPassThreads, SortByDigit<D>,
                RadixPairs{buffers.keys.Current(), buffers.values.Current()},
                RadixPairs{buffers.keys.Alternate(), buffers.values.Alternate()}, count, pass, bits, room);
    VOXELPIPE_LAUNCHED_OR_RETURN("SortByDigit");
    buffers.keys.selector ^= 1;
    buffers.values.selector ^= 1;
  }
  return absl::OkStatus();
}

absl::Status SortNarrow(const Work& work, Buffers<uint32_t>& buffers) {
  if (work.count > kMostSortedByDigits) return Sort(work, buffers);
  if ((work.bits + 8) / 9 < (work.bits + 7) / 8) return SortByDigits<Digits<9, 512, 17>>(work, buffers);
  if (!work.scattered) return SortByDigits<Digits<8, 512, 17>>(work, buffers);
  return SortByDigits<Digits<8, 384, 23>>(work, buffers);
}
#else
absl::Status SortNarrow(const Work& work, Buffers<uint32_t>& buffers) {
  return Sort(work, buffers);
}
#endif

template <typename Key>
Buffers<Key> BuffersOf(Fragments& fragments) {
  return {cub::DoubleBuffer<Key>(fragments.KeysAs<Key>(0), fragments.KeysAs<Key>(1)),
          cub::DoubleBuffer<uint32_t>(fragments.triangles[0].data(), fragments.triangles[1].data())};
}

}  // namespace

absl::Status SortByKey(Fragments& fragments, const KeySort& sort, const DeviceInfo& device,
                       DeviceArray<uint8_t>& scratch, cudaStream_t stream) {
  const Work work{fragments.elements(), sort.bits, sort.scattered, sort.beside, device, scratch, stream};
  uint32_t* sorted = nullptr;
  if (sort.wide_keys) {
    Buffers<uint64_t> buffers = BuffersOf<uint64_t>(fragments);
    VOXELPIPE_OK_OR_RETURN(Sort(work, buffers));
    sorted = buffers.values.Current();
  } else {
    Buffers<uint32_t> buffers = BuffersOf<uint32_t>(fragments);
    VOXELPIPE_OK_OR_RETURN(SortNarrow(work, buffers));
    sorted = buffers.values.Current();
  }
  fragments.current = sorted == fragments.triangles[0].data() ? 0 : 1;
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
