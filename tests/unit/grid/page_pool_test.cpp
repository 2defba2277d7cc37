#include "grid/page_pool.h"

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

// Bytes just below the pool's least, which lines of a cache fill up to it: they came from the pool as a block that was no whole page.
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

}  // namespace
}  // namespace voxelpipe
