#include "schedule/batch_room.h"

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

JobCost Cost(uint64_t output_bytes, uint64_t device_bytes = 0) {
  JobCost cost;
  cost.output_bytes = output_bytes;
  cost.device_bytes = device_bytes;
  return cost;
}

TEST(BatchRoomTest, TheFirstAlwaysFits) {
  const BatchRoom room({1, 1, 1, 1});
  EXPECT_TRUE(room.Fits(Cost(UINT64_MAX, UINT64_MAX), 1e9));
}

TEST(BatchRoomTest, EachLimitEndsABatch) {
  const auto fits = [](const BatchLimits& limits) {
    BatchRoom room(limits);
    room.Add(Cost(10, 10), 10);
    return room.Fits(Cost(10, 10), 10);
  };
  EXPECT_TRUE(fits({2, 20, 20, 20}));
  EXPECT_TRUE(fits({2, 20, 20, 0})) << "no limit of the device";
  EXPECT_FALSE(fits({1, 20, 20, 20}));
  EXPECT_FALSE(fits({2, 19, 20, 20}));
  EXPECT_FALSE(fits({2, 20, 19, 20}));
  EXPECT_FALSE(fits({2, 20, 20, 19}));
}

}  // namespace
}  // namespace voxelpipe
