// The primitives of core/cuda at the borders of warps and blocks, against loops on the host. Built twice: for a GPU,
// and for the emulator.
#include <cuda_runtime_api.h>

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

#include "cuda/coverage/emit_spans.cuh"
#include "cuda/coverage/set_bits.cuh"
#include "cuda/primitives/brick_allocator.cuh"
#include "cuda/primitives/decoupled_look_back.cuh"
#include "cuda/primitives/warp_reduce.cuh"
#include "cuda/traversal/row_traversal.cuh"
#include "gtest/gtest.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 128;

// Around the borders of a warp, of a block, and of several blocks.
constexpr uint32_t kCounts[] = {1, 31, 32, 33, 127, 128, 129, 255, 256, 257, 1000};

// Memory that the host sees between kernels.
template <typename T>
class Shared {
 public:
  explicit Shared(size_t count, T value = T()) : count_(count) {
    EXPECT_EQ(cudaMallocManaged(reinterpret_cast<void**>(&data_), std::max<size_t>(count, 1) * sizeof(T)), cudaSuccess);
    std::fill_n(data_, count, value);
  }
  explicit Shared(const std::vector<T>& values) : Shared(values.size()) {
    std::copy(values.begin(), values.end(), data_);
  }
  ~Shared() { (void)cudaFree(data_); }
  Shared(const Shared&) = delete;
  Shared& operator=(const Shared&) = delete;
  T* data() { return data_; }
  T& operator[](size_t i) { return data_[i]; }
  std::vector<T> values() const { return std::vector<T>(data_, data_ + count_); }

 private:
  T* data_ = nullptr;
  size_t count_;
};

void Wait() {
  ASSERT_EQ(cudaDeviceSynchronize(), cudaSuccess);
}

class PrimitivesTest : public ::testing::TestWithParam<uint32_t> {
 protected:
  void SetUp() override {
    int devices = 0;
    if (cudaGetDeviceCount(&devices) != cudaSuccess || devices == 0) {
      (void)cudaGetLastError();
      GTEST_SKIP() << "no CUDA device";
    }
  }
};

// Each warp lists the owners of its lanes' items in order.
__global__ void ListOwners(const uint32_t* counts, uint32_t lanes, uint32_t* totals, uint32_t* owners) {
  const uint32_t t = blockIdx.x * kThreads + threadIdx.x, warp = t / 32;
  uint32_t total;
  const uint32_t before = WarpExclusiveSum(t < lanes ? counts[t] : 0, total);
  for (uint32_t first = 0; first < total; first += 32) {
    const uint32_t item = first + threadIdx.x % 32;
    const int owner = LaneOfItem(before, item);
    if (item < total) owners[warp * 32 * 8 + item] = warp * 32 + uint32_t(owner);
  }
  if (threadIdx.x % 32 == 0) totals[warp] = total;
}

TEST_P(PrimitivesTest, LanesOfAWarpShareTheItemsOfAll) {
  const uint32_t lanes = GetParam(), blocks = (lanes + kThreads - 1) / kThreads, warps = blocks * kThreads / 32;
  Shared<uint32_t> counts(lanes), totals(warps), owners(size_t{warps} * 32 * 8);
  for (uint32_t i = 0; i < lanes; ++i) counts[i] = i * 7 % 9;  // some have none
  ListOwners<<<blocks, kThreads>>>(counts.data(), lanes, totals.data(), owners.data());
  Wait();
  for (uint32_t warp = 0; warp < warps; ++warp) {
    std::vector<uint32_t> expected;
    for (uint32_t i = warp * 32; i < std::min(lanes, warp * 32 + 32); ++i)
      expected.insert(expected.end(), counts[i], i);
    ASSERT_EQ(totals[warp], expected.size());
    for (size_t i = 0; i < expected.size(); ++i) EXPECT_EQ(owners[size_t{warp} * 32 * 8 + i], expected[i]);
  }
}

__global__ void Reduce(const uint32_t* in, uint32_t count, uint32_t* sums, uint32_t* least, uint32_t* largest,
                       uint64_t* of_block) {
  __shared__ uint64_t warps[kThreads / 32];
  const uint32_t t = blockIdx.x * kThreads + threadIdx.x;
  const uint32_t value = t < count ? in[t] : 0;
  const uint64_t upto = SumUpto(uint64_t{value});
  if (threadIdx.x % 32 == 31) warps[threadIdx.x / 32] = upto;
  __syncthreads();
  uint64_t all;
  const uint64_t before = SumOfWarps(warps, all);
  if (t < count) of_block[t] = before + upto;
  sums[t / 32] = WarpSum(value);
  least[t / 32] = WarpLeast(t < count ? value : ~0u);
  largest[t / 32] = WarpLargest(value);
}

TEST_P(PrimitivesTest, SumsAndBoundsOfWarpsAndBlocksAreThoseOfLoops) {
  const uint32_t count = GetParam(), blocks = (count + kThreads - 1) / kThreads, warps = blocks * kThreads / 32;
  Shared<uint32_t> in(count), sums(warps), least(warps), largest(warps);
  Shared<uint64_t> of_block(count);
  for (uint32_t i = 0; i < count; ++i) in[i] = 1 + i * 2654435761u % 100000;
  Reduce<<<blocks, kThreads>>>(in.data(), count, sums.data(), least.data(), largest.data(), of_block.data());
  Wait();
  uint64_t running = 0;
  for (uint32_t i = 0; i < count; ++i) {
    running = i % kThreads == 0 ? in[i] : running + in[i];
    EXPECT_EQ(of_block[i], running) << i;
  }
  for (uint32_t warp = 0; warp * 32 < count; ++warp) {
    const uint32_t* const begin = in.data() + warp * 32;
    const uint32_t* const end = in.data() + std::min(count, warp * 32 + 32);
    EXPECT_EQ(sums[warp], std::accumulate(begin, end, 0u));
    EXPECT_EQ(least[warp], *std::min_element(begin, end));
    EXPECT_EQ(largest[warp], *std::max_element(begin, end));
  }
}

template <bool kBlock>
__global__ void Append(const uint32_t* counts, uint32_t lanes, uint64_t* counter, uint32_t* list) {
  __shared__ unsigned long long room[kThreads / 32 + 1];
  const uint32_t t = blockIdx.x * kThreads + threadIdx.x, count = t < lanes ? counts[t] : 0;
  uint64_t at = 0;
  if constexpr (kBlock) {
    at = BlockAllocate<kThreads>(counter, count, room);
  } else {
    at = WarpAllocate(counter, count);
  }
  for (uint32_t i = 0; i < count; ++i) list[at + i] = t;
}

TEST_P(PrimitivesTest, WhatIsAppendedTakesEveryPlaceOnce) {
  const uint32_t lanes = GetParam(), blocks = (lanes + kThreads - 1) / kThreads;
  for (const bool block : {false, true}) {
    Shared<uint32_t> counts(lanes), list(size_t{lanes} * 4, ~0u);
    Shared<uint64_t> counter(1);
    std::vector<uint32_t> expected;
    for (uint32_t i = 0; i < lanes; ++i) {
      counts[i] = i % 5 == 0 ? 0 : i % 4;
      expected.insert(expected.end(), counts[i], i);
    }
    if (block) {
      Append<true><<<blocks, kThreads>>>(counts.data(), lanes, counter.data(), list.data());
    } else {
      Append<false><<<blocks, kThreads>>>(counts.data(), lanes, counter.data(), list.data());
    }
    Wait();
    ASSERT_EQ(counter[0], expected.size());
    std::vector<uint32_t> found = list.values();
    found.resize(expected.size());
    std::sort(found.begin(), found.end());
    EXPECT_EQ(found, expected);
  }
}

__global__ void SumBlocksBefore(const uint64_t* in, uint64_t* said, uint64_t* out) {
  if (threadIdx.x >= 32) return;
  SayHere(said, in[blockIdx.x]);
  const uint64_t before = LookBack(said, in[blockIdx.x]);
  if (threadIdx.x == 0) out[blockIdx.x] = before;
}

TEST_P(PrimitivesTest, ABlockLooksBackOverAllBlocksBeforeIt) {
  const uint32_t blocks = GetParam();
  Shared<uint64_t> in(blocks), said(blocks), out(blocks);
  for (uint32_t i = 0; i < blocks; ++i) in[i] = uint64_t{i % 3} << 40 | i;
  SumBlocksBefore<<<blocks, 64>>>(in.data(), said.data(), out.data());
  Wait();
  uint64_t sum = 0;
  for (uint32_t i = 0; i < blocks; ++i) {
    EXPECT_EQ(out[i], sum) << i;
    sum += in[i];
  }
}

__global__ void CountSetBits(const uint32_t* grid, uint64_t words, uint32_t* visits) {
  const uint64_t warp = uint64_t(blockIdx.x) * (kThreads / 32) + threadIdx.x / 32;
  ForEachSetBit(grid, words, warp, uint64_t(gridDim.x) * (kThreads / 32),
                [&](uint64_t word, uint32_t x) { atomicAdd(visits + word * 32 + x, 1u); });
}

TEST_P(PrimitivesTest, EverySetBitOfAGridIsVisitedOnce) {
  const uint32_t words = GetParam();
  Shared<uint32_t> grid(words), visits(size_t{words} * 32);
  for (uint32_t w = 0; w < words; ++w) grid[w] = w % 3 == 0 ? 0 : w % 7 == 0 ? ~0u : w * 2654435761u;
  grid[words - 1] |= 1u << 31;
  CountSetBits<<<2, kThreads>>>(grid.data(), words, visits.data());
  Wait();
  for (uint32_t i = 0; i < words * 32; ++i) EXPECT_EQ(visits[i], grid[i / 32] >> (i % 32) & 1) << i;
}

constexpr unsigned kPiece = 64;
__global__ void WritePieces(uint32_t of_warp, uint64_t capacity, uint64_t* counter, uint32_t* list) {
  const uint32_t warp = blockIdx.x * (kThreads / 32) + threadIdx.x / 32, lane = threadIdx.x % 32;
  PieceWriter<uint32_t, kPiece> writer(list, capacity, 0, counter, ~0u);
  for (uint32_t first = 0; first < of_warp; first += 32) {
    const uint32_t lanes = __ballot_sync(~0u, first + lane < of_warp);
    writer.Put(lanes, warp * 4096 + first + lane);
  }
  __syncwarp();
  writer.Close();
}

TEST_P(PrimitivesTest, PiecesOfAListHaveAllEntriesAndNothingElse) {
  const uint32_t of_warp = GetParam(), warps = 3 * kThreads / 32;
  const uint64_t capacity = uint64_t{warps} * (of_warp / kPiece + 1) * kPiece;
  Shared<uint32_t> list(capacity, ~0u - 1);
  Shared<uint64_t> counter(1);
  WritePieces<<<3, kThreads>>>(of_warp, capacity, counter.data(), list.data());
  Wait();
  ASSERT_LE(counter[0], capacity);
  std::vector<uint32_t> found = list.values(), expected;
  found.resize(counter[0]);
  found.erase(std::remove(found.begin(), found.end(), ~0u), found.end());
  std::sort(found.begin(), found.end());
  for (uint32_t warp = 0; warp < warps; ++warp) {
    for (uint32_t i = 0; i < of_warp; ++i) expected.push_back(warp * 4096 + i);
  }
  EXPECT_EQ(found, expected);
}

struct TestPool {
  static constexpr unsigned kWordsOfPlace = 32;
  uint32_t* places;
  uint64_t* asked;
  uint64_t capacity;
  uint32_t *words, *names;
  __device__ uint32_t* WordsOf(uint64_t number) const { return words + number * kWordsOfPlace; }
  __device__ void Name(uint64_t number, uint32_t brick) const { names[number] = brick; }
};

__global__ void CountInBricks(TestPool pool, uint32_t count, uint32_t bricks, uint32_t* lost) {
  const uint32_t t = blockIdx.x * kThreads + threadIdx.x, brick = t * 13 % bricks;
  const uint32_t place = PlaceOf(pool, t < count, brick);
  if (t >= count) return;
  if (IsPlace(place)) {
    atomicAdd(pool.WordsOf(place - kFirstPlace) + t % TestPool::kWordsOfPlace, 1u);
  } else {
    atomicAdd(lost, 1u);
  }
}

TEST_P(PrimitivesTest, EveryBrickGetsOneEmptyPlaceWhileThereAreSome) {
  const uint32_t count = GetParam(), bricks = count / 3 + 1, blocks = (count + kThreads - 1) / kThreads;
  for (const uint64_t capacity : {uint64_t{bricks}, uint64_t{bricks / 2}}) {
    Shared<uint32_t> places(bricks), words(capacity * TestPool::kWordsOfPlace, 77), names(capacity, ~0u), lost(1);
    Shared<uint64_t> asked(1);
    TestPool pool{places.data(), asked.data(), capacity, words.data(), names.data()};
    CountInBricks<<<blocks, kThreads>>>(pool, count, bricks, lost.data());
    Wait();
    std::vector<uint32_t> wanted(bricks), found(bricks);
    for (uint32_t t = 0; t < count; ++t) ++wanted[t * 13 % bricks];
    const auto used = uint64_t(std::count_if(wanted.begin(), wanted.end(), [](uint32_t n) { return n > 0; }));
    EXPECT_EQ(asked[0], used);
    uint32_t counted = 0;
    for (uint64_t place = 0; place < std::min(used, capacity); ++place) {
      const uint32_t brick = names[place];
      ASSERT_LT(brick, bricks);
      for (unsigned w = 0; w < TestPool::kWordsOfPlace; ++w) found[brick] += words[place * TestPool::kWordsOfPlace + w];
      EXPECT_EQ(found[brick], wanted[brick]);
      counted += found[brick];
    }
    EXPECT_EQ(counted + lost[0], count);
    EXPECT_EQ(lost[0] > 0, used > capacity);
  }
}

INSTANTIATE_TEST_SUITE_P(Counts, PrimitivesTest, ::testing::ValuesIn(kCounts));

}  // namespace
}  // namespace voxelpipe::cuda
