#include "reply/write_ahead.h"

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

TEST(WriteAheadTest, OnlyWhatMoreFollowsMayWaitForIt) {
  WriteAhead writes;
  writes.Next(false);
  EXPECT_TRUE(writes.Next(true).get_buffer_hint());
  EXPECT_FALSE(writes.Next(false).get_buffer_hint());
  EXPECT_TRUE(writes.Next(true).get_buffer_hint());
}

TEST(WriteAheadTest, TheFirstWriteNeverWaits) {
  WriteAhead writes;
  EXPECT_FALSE(writes.Next(true).get_buffer_hint());
  EXPECT_TRUE(writes.Next(true).get_buffer_hint());
}

}  // namespace
}  // namespace voxelpipe
