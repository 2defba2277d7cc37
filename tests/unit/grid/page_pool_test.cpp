#include "grid/page_pool.h"

#include <sys/mman.h>

#include <chrono>

#include "grid/idle_pages.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

// Bytes just below the pool's least, which lines of a cache fill up to it: they came from the pool as a block that was
// no whole page.
TEST(PagePoolTest, ABlockThatRoundingBringsIntoThePoolHasWholePages) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "no pool with AddressSanitizer";
#endif
  ReleaseIdlePages();
  void* const first = TakePages(kPooledBytes - 1);
  ASSERT_NE(first, nullptr);
  ReturnPages(first, kPooledBytes - 1);
  void* const second = TakePages(kPooledBytes);
  EXPECT_EQ(second, first) << "of another size";
  ReturnPages(second, kPooledBytes);
}

TEST(PagePoolTest, ABlockThatIsNotMuchLargerGivesAPart) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "no pool with AddressSanitizer";
#endif
  ReleaseIdlePages();
  auto* const larger = static_cast<uint8_t*>(TakePages(12 * kPooledUnit));
  ASSERT_NE(larger, nullptr);
  ReturnPages(larger, 12 * kPooledUnit);
  auto* const part = static_cast<uint8_t*>(TakePages(10 * kPooledUnit));
  EXPECT_EQ(part, larger);
  unsigned char resident;
  EXPECT_EQ(mincore(part + 9 * kPooledUnit, 1, &resident), 0);
  EXPECT_NE(mincore(part + 10 * kPooledUnit, 1, &resident), 0) << "the rest is the system's";
  ReturnPages(part, 10 * kPooledUnit);
  void* const small = TakePages(kPooledUnit);
  EXPECT_NE(small, part) << "too much would be lost";
  ReturnPages(small, kPooledUnit);
  ReleaseIdlePages();
}

TEST(PagePoolTest, BlocksUnusedSinceAMomentGoToTheSystemAndYoungerOnesStay) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "no pool with AddressSanitizer";
#endif
  constexpr uint64_t kBytes = 40 << 20;
  const auto is_mapped = [](void* block) {
    unsigned char resident;
    return mincore(block, 1, &resident) == 0;
  };
  ReleaseIdlePages();
  void* const old = TakePages(kBytes);
  void* const young = TakePages(kBytes);
  ASSERT_NE(old, nullptr);
  ASSERT_NE(young, nullptr);
  EXPECT_TRUE(is_mapped(old));
  ReturnPages(old, kBytes);
  const auto between = std::chrono::steady_clock::now();
  while (std::chrono::steady_clock::now() == between) {}
  ReturnPages(young, kBytes);
  ReleasePagesIdleSince(between);
  EXPECT_FALSE(is_mapped(old));
  void* const again = TakePages(kBytes);
  EXPECT_EQ(again, young);
  ReturnPages(again, kBytes);
}

}  // namespace
}  // namespace voxelpipe
