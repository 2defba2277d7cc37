#include "grid/host_buffer.h"

#include <array>
#include <utility>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

struct Given {
  void* block = nullptr;
  uint64_t bytes = 0;
  int times = 0;
};
Given given;

void TakeBack(void* block, uint64_t bytes) {
  given = {block, bytes, given.times + 1};
}

TEST(HostBufferTest, GivesAnAdoptedBlockBackOnce) {
  given = {};
  std::array<uint8_t, 24> block{};
  {
    HostBuffer first = HostBuffer::Adopt(block.data(), block.size(), &TakeBack);
    first.data()[3] = 7;
    HostBuffer second = std::move(first);
    EXPECT_EQ(second.bytes().size(), block.size());
    EXPECT_EQ(second.bytes()[3], 7);
    EXPECT_EQ(given.times, 0);
  }
  EXPECT_EQ(given.times, 1);
  EXPECT_EQ(given.block, block.data());
  EXPECT_EQ(given.bytes, block.size());
}

TEST(HostBufferTest, GivesAnAdoptedBlockBackWhenAnotherTakesItsPlace) {
  given = {};
  std::array<uint8_t, 8> block{};
  HostBuffer buffer = HostBuffer::Adopt(block.data(), block.size(), &TakeBack);
  buffer = *HostBuffer::Allocate(16);
  EXPECT_EQ(given.times, 1);
  EXPECT_EQ(buffer.size(), 16u);
}

}  // namespace
}  // namespace voxelpipe
