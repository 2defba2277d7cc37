#include "grid/bit_grid.h"

#include <random>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

// Widths below, at and above a byte, a word and a tile.
class BitGridTest : public ::testing::TestWithParam<int64_t> {};

TEST_P(BitGridTest, PacksTheLinearOrderWithoutPadding) {
  const std::array<int64_t, 3> dims{GetParam(), 7, 5};
  auto grid = BitGrid::Create(dims);
  ASSERT_TRUE(grid.ok());
  std::mt19937 random{uint32_t(GetParam())};
  const uint64_t voxels = uint64_t(dims[0] * dims[1] * dims[2]);
  std::vector<bool> expected(voxels);
  uint64_t set = 0;
  for (uint64_t n = 0; n < voxels; ++n) {
    if (random() % 3 != 0) continue;
    expected[n] = true;
    ++set;
    const int64_t x = int64_t(n) % dims[0];
    grid->row(int64_t(n) / dims[0])[x / 32] |= 1u << (x % 32);
  }
  EXPECT_EQ(CountBits(*grid), set);
  std::vector<uint8_t> packed((voxels + 7) / 8, 0xcc);
  PackBits(dims, packed, [&](int64_t r, int64_t w) { return grid->row(r)[w]; });
  for (uint64_t n = 0; n < voxels; ++n) ASSERT_EQ((packed[n / 8] >> (n % 8)) & 1, expected[n]) << n;
  if (voxels % 8 != 0) {
    EXPECT_EQ(packed.back() >> (voxels % 8), 0);  // unused bits are 0
  }
}

INSTANTIATE_TEST_SUITE_P(Widths, BitGridTest,
                         ::testing::Values(1, 2, 7, 8, 9, 31, 32, 33, 63, 64, 65, 100, 8192, 70000));

TEST(BitGridUnionTest, CountsEachVoxelOnce) {
  auto a = BitGrid::Create({40, 2, 1}), b = BitGrid::Create({40, 2, 1});
  ASSERT_TRUE(a.ok() && b.ok());
  a->row(0)[1] = 0x0f;
  b->row(0)[1] = 0x3c;
  b->row(1)[0] = 1;
  EXPECT_EQ(CountUnion(*a, *b), 7u);
}

}  // namespace
}  // namespace voxelpipe
