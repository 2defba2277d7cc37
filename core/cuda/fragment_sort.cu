#include <cub/device/device_radix_sort.cuh>

#include <algorithm>

#include "cuda/fragments.h"

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
#endif

namespace voxelpipe::cuda {
namespace {

struct Work {
  uint64_t count;
  int bits;
  bool scattered;
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
  return WithScratch(work, [&](void* scratch, size_t& bytes) {
    return cub::DeviceRadixSort::SortPairs(scratch, bytes, buffers.keys, buffers.values, work.count, 0, work.bits,
                                           work.stream);
  });
}

// CUB sorts 8 bits a pass. Keys of 25 to 27 bits go in three passes of 9 bits, which takes less than four; with 10 bits, for 30, each
// pass took longer than it saved. CUB's dispatcher takes the number as a parameter.
#ifdef VOXELPIPE_TUNES_CUB
template <int kBits, int kThreads, int kItems>
struct DigitPolicies {
  using Hub = cub::detail::radix::policy_hub<uint32_t, uint32_t, uint32_t>;
  using Base = Hub::OnesweepSmallKeyTunedPolicy<cub::detail::radix::sm90_small_key_tuning<4, 4, 4>>;
  struct Policy : cub::ChainedPolicy<500, Policy, Policy>, Base {
    static constexpr bool ONESWEEP = true;
    static constexpr int ONESWEEP_RADIX_BITS = kBits;
    // Blocks of 128 threads, as CUB has them, add four times as many counts of theirs to those of all.
    using HistogramPolicy = cub::AgentRadixSortHistogramPolicy<512, 16, 1, uint32_t, kBits>;
    using ExclusiveSumPolicy = cub::AgentRadixSortExclusiveSumPolicy<256, kBits>;
    using OnesweepPolicy =
        cub::AgentRadixSortOnesweepPolicy<kThreads, kItems, uint32_t, 1, cub::RADIX_RANK_MATCH_EARLY_COUNTS_ANY,
                                          cub::BLOCK_SCAN_RAKING_MEMOIZE, cub::RADIX_SORT_STORE_DIRECT, kBits>;
  };
  using MaxPolicy = Policy;
};

template <typename Policies>
absl::Status SortByDigits(const Work& work, Buffers<uint32_t>& buffers) {
  using Dispatch = cub::DispatchRadixSort<cub::SortOrder::Ascending, uint32_t, uint32_t, uint32_t,
                                          cub::detail::identity_decomposer_t, Policies>;
  return WithScratch(work, [&](void* scratch, size_t& bytes) {
    return Dispatch::Dispatch(scratch, bytes, buffers.keys, buffers.values, uint32_t(work.count), 0, work.bits, true,
                              work.stream);
  });
}

absl::Status SortNarrow(const Work& work, Buffers<uint32_t>& buffers) {
  if (work.count >= uint64_t{1} << 31) return Sort(work, buffers);
  if ((work.bits + 8) / 9 < (work.bits + 7) / 8) return SortByDigits<DigitPolicies<9, 512, 17>>(work, buffers);
  if (!work.scattered) return SortByDigits<DigitPolicies<8, 512, 17>>(work, buffers);
  return SortByDigits<DigitPolicies<8, 384, 23>>(work, buffers);
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

absl::Status SortByKey(Fragments& fragments, bool wide_keys, int bits, bool scattered, DeviceArray<uint8_t>& scratch,
                       cudaStream_t stream) {
  const Work work{fragments.elements(), bits, scattered, scratch, stream};
  CountLaunch();
  uint32_t* sorted = nullptr;
  if (wide_keys) {
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
