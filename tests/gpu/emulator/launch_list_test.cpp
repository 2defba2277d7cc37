// Lists of kernels: which are alike, which arguments differ, and that a launch passes them on.
#include "cuda/device/kernel_list.h"

#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe::cuda {

bool BeginsEarly(const DeviceInfo&) {
  return true;
}

namespace {

struct Wide {
  uint64_t numbers[9];
  uint8_t last;
};

std::vector<uint64_t> seen;

void Nothing() {
  seen.push_back(0);
}
void One(const Wide wide) {
  seen.push_back(wide.numbers[8] + wide.last);
}
void Two(uint8_t small, const uint64_t* pointer) {
  seen.push_back(small);
  seen.push_back(*pointer);
}

const uint64_t kFive = 5, kSix = 6;

LaunchList Listed(unsigned blocks, uint8_t last, const uint64_t* pointer) {
  LaunchList list;
  list.Add("Nothing", Begins::kBehind, 1, 1, Nothing);
  list.Add("One", Begins::kBehind, blocks, 1, One, Wide{{0, 0, 0, 0, 0, 0, 0, 0, 1}, last});
  list.Add("Two", Begins::kEarly, dim3(1, blocks), 1, Two, uint8_t{3}, pointer);
  return list;
}

TEST(LaunchList, ListsAreAlikeWhateverTheirArguments) {
  const LaunchList list = Listed(1, 2, &kFive);
  EXPECT_TRUE(list.IsLike(Listed(1, 9, &kSix)));
  EXPECT_FALSE(list.IsLike(Listed(2, 2, &kFive)));
  LaunchList other = list;
  other.Add("Nothing", Begins::kBehind, 1, 1, Nothing);
  EXPECT_FALSE(list.IsLike(other));
  LaunchList behind, early;
  behind.Add("Nothing", Begins::kBehind, 1, 1, Nothing);
  early.Add("Nothing", Begins::kEarly, 1, 1, Nothing);
  EXPECT_FALSE(behind.IsLike(early));
}

TEST(LaunchList, TellsWhichArgumentsDiffer) {
  const LaunchList list = Listed(1, 2, &kFive), other = Listed(1, 2, &kSix);
  EXPECT_TRUE(list.HasArgumentsOf(other, 0));
  EXPECT_FALSE(list.HasArgumentsOf(other, 2));
  EXPECT_TRUE(list.HasArgumentsOf(LaunchList(list), 2));
}

TEST(LaunchList, LaunchesPassArgumentsOn) {
  seen.clear();
  const LaunchList list = Listed(1, 2, &kFive);
  for (const ListedLaunch& launch : list.launches()) {
    const cudaLaunchConfig_t config{launch.blocks, dim3(launch.threads), 0, nullptr, nullptr, 0};
    EXPECT_EQ(launch.launch(config, launch.kernel, list.ArgumentsOf(launch).data()), cudaSuccess);
  }
  EXPECT_EQ(seen, (std::vector<uint64_t>{0, 3, 3, 5}));
}

}  // namespace
}  // namespace voxelpipe::cuda
