// What the search for races finds, and what it takes for ordered.
#include "gtest/gtest.h"

namespace cuda_emulator {
namespace {

const Config kBlock{1, 64};
const Config kWarp{1, 32};
const Config kTwoBlocks{2, 1};
const Config kEarly{1, 1, 0, nullptr, true};

uint32_t shared[64];  // as what translate.py makes of shared memory

// Of a device's memory, since what is static is taken for a block's.
struct Device {
  uint32_t* const at = static_cast<uint32_t*>(calloc(64, sizeof(uint32_t)));
  ~Device() { free(at); }
};

// A read that stays one.
void Look(const uint32_t* at) {
  [[maybe_unused]] const volatile uint32_t seen = *at;
}

template <typename Kernel>
size_t RacesOf(const Config& config, const Kernel& kernel) {
  Launch(config, kernel);
  return races::Forget();
}

TEST(Races, BarriersOrderABlock) {
  const auto kernel = [&](bool waits, bool waits_again) {
    for (int round = 0; round < 2; ++round) {
      shared[threadIdx.x] = threadIdx.x;
      if (waits) __syncthreads();
      if (threadIdx.x == 0) Look(shared + 63);
      if (waits_again) __syncthreads();
    }
  };
  EXPECT_EQ(RacesOf(kBlock, [&] { kernel(true, true); }), 0u);
  EXPECT_GT(RacesOf(kBlock, [&] { kernel(false, true); }), 0u);
  EXPECT_GT(RacesOf(kBlock, [&] { kernel(true, false); }), 0u);
}

TEST(Races, WarpsAreOrderedBySyncwarpAlone) {
  const auto kernel = [&](bool waits) {
    shared[threadIdx.x] = threadIdx.x;
    (void)__shfl_sync(~0u, 1, 0);
    if (waits) __syncwarp();
    if (threadIdx.x == 0) Look(shared + 31);
  };
  EXPECT_EQ(RacesOf(kWarp, [&] { kernel(true); }), 0u);
  EXPECT_GT(RacesOf(kWarp, [&] { kernel(false); }), 0u);
}

TEST(Races, AtomicsAreNoneAmongThemselves) {
  const Device memory;
  EXPECT_EQ(RacesOf(kTwoBlocks, [&] { atomicAdd(memory.at, 1u); }), 0u);
  EXPECT_EQ(RacesOf(kTwoBlocks, [&] { memory.at[blockIdx.x] = 1; }), 0u);
  EXPECT_GT(RacesOf(kTwoBlocks, [&] { *memory.at = 1; }), 0u);
  EXPECT_GT(RacesOf(kTwoBlocks,
                    [&] {
                      if (blockIdx.x == 0) *memory.at = 1;
                      if (blockIdx.x == 1) atomicAdd(memory.at, 1u);
                    }),
            0u);
}

TEST(Races, AFenceAndAFlagOrderBlocks) {
  const Device memory;
  const auto kernel = [&](bool fences) {
    volatile uint32_t* const flag = memory.at + 1;
    if (blockIdx.x == 0) {
      *memory.at = 1;
      if (fences) __threadfence();
      *flag = 1;
    } else if (*flag == 1) {
      Look(memory.at);
    }
  };
  EXPECT_EQ(RacesOf(kTwoBlocks, [&] { kernel(true); }), 0u);
  EXPECT_GT(RacesOf(kTwoBlocks, [&] { kernel(false); }), 0u);
}

TEST(Races, WhatOneThreadPublishesIsWhatItsBlockDidBeforeTheBarrier) {
  const Device memory;
  const auto kernel = [&](bool waits) {
    memory.at[blockIdx.x * 32 + threadIdx.x] = 1;
    if (waits) __syncthreads();
    if (threadIdx.x > 0) return;
    __threadfence();
    if (atomicAdd(memory.at + 16, 1u) == 0) return;
    for (int i = 0; i < 4; ++i) Look(memory.at + i);  // the last block reads what the first wrote
  };
  EXPECT_EQ(RacesOf({2, 4}, [&] { kernel(true); }), 0u);
  memory.at[16] = 0;
  EXPECT_GT(RacesOf({2, 4}, [&] { kernel(false); }), 0u);
}

TEST(Races, KernelsThatBeginEarlyAreOrderedByTheirWait) {
  const Device memory;
  const auto write = [&] { *memory.at = 1; };
  const auto read = [&](bool waits_before) {
    if (waits_before) races::AwaitEarlier();
    Look(memory.at);
    if (!waits_before) races::AwaitEarlier();
  };
  Launch({1, 1}, write);
  EXPECT_EQ(RacesOf(kEarly, [&] { read(true); }), 0u);
  Launch({1, 1}, write);
  EXPECT_GT(RacesOf(kEarly, [&] { read(false); }), 0u);
  Launch({1, 1}, write);
  EXPECT_EQ(RacesOf({1, 1}, [&] { Look(memory.at); }), 0u);
  Launch({1, 1}, write);
  EXPECT_GT(RacesOf(kEarly, [] {}), 0u) << "it never waits";
}

TEST(Races, AFenceAndAFlagOrderAKernelThatBeginsEarly) {
  const Device memory;
  const auto read = [&] {
    if (*const_cast<volatile uint32_t*>(memory.at + 1) == 1) Look(memory.at);
    races::AwaitEarlier();
  };
  for (const bool fences : {true, false}) {
    Launch({1, 1}, [&] {
      *memory.at = 1;
      if (fences) __threadfence();
      *const_cast<volatile uint32_t*>(memory.at + 1) = 1;
    });
    EXPECT_EQ(RacesOf(kEarly, read) == 0, fences);
  }
}

TEST(Races, ACounterTellsAKernelThatBeginsEarlyWhatBlocksDid) {
  const Device memory;
  const auto write = [&](bool waits) {
    memory.at[blockIdx.x * 32 + threadIdx.x] = 1;
    if (waits) __syncthreads();
    if (threadIdx.x > 0) return;
    __threadfence();
    atomicAdd(memory.at + 16, 1u);
  };
  const auto read = [&](uint32_t counter) {
    if (*const_cast<volatile uint32_t*>(memory.at + 16) == counter) {
      for (int i = 0; i < 4; ++i) Look(memory.at + i);
    }
    races::AwaitEarlier();
  };
  for (const bool waits : {true, false}) {
    memory.at[16] = 0;
    Launch({2, 4}, [&] { write(waits); });
    EXPECT_EQ(RacesOf(kEarly, [&] { read(2); }) == 0, waits);
  }
  // Set back by somebody who has waited for nothing, it tells nothing.
  memory.at[16] = 0;
  Launch({2, 4}, [&] { write(true); });
  EXPECT_GT(RacesOf(cuda_emulator::Config{2, 1, 0, nullptr, true},
                    [&] {
                      if (blockIdx.x == 0) *const_cast<volatile uint32_t*>(memory.at + 16) = 0;
                      if (blockIdx.x == 1) return read(0);
                      races::AwaitEarlier();
                    }),
            0u);
}

TEST(Races, WhoLetsTheNextBeginBeforeItWaitsTellsItLess) {
  const Device memory;
  const auto between = [&](bool waits_before) {
    if (waits_before) races::AwaitEarlier();
    races::AllowNext();
    if (!waits_before) races::AwaitEarlier();
  };
  for (const bool waits_before : {true, false}) {
    Launch({1, 1}, [&] { *memory.at = 1; });
    Launch(kEarly, [&] { between(waits_before); });
    const size_t found = RacesOf(kEarly, [&] {
      Look(memory.at);  // of the first kernel
      races::AwaitEarlier();
    });
    EXPECT_EQ(found == 0, waits_before);
  }
}

}  // namespace
}  // namespace cuda_emulator
