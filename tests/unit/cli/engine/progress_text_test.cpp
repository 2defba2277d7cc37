// How progress is written.
#include "engine/progress_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/json/json.h"

namespace voxelpipe::cli {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

ProgressState List(size_t ended, size_t items, double elapsed_ms) {
  ProgressState state;
  state.stage = "load";
  state.fraction = 0.5;
  state.item = ended + 1;
  state.items = items;
  state.ended = ended;
  state.elapsed_ms = elapsed_ms;
  return state;
}

TEST(ProgressText, ALineOfOneMeshHasStageShareAndVoxelRate) {
  ProgressState state = List(0, 1, 1000);
  state.stage = "fine_raster";
  EXPECT_EQ(ProgressLine(state, 80), "[#####.....]  50 %  fine_raster");
  state.voxels_per_second = 12345678;
  EXPECT_EQ(ProgressLine(state, 80), "[#####.....]  50 %  fine_raster, 12.3 M voxels/s");
  EXPECT_EQ(ProgressLine(state, 10), "[#####....");
}

TEST(ProgressText, ALineOfAListHasItemRateAndTimeLeft) {
  EXPECT_EQ(ProgressLine(List(0, 4, 1000), 80), "[..........]   0 %  0 of 4, load");
  EXPECT_EQ(ProgressLine(List(1, 4, 2000), 80), "[##........]  25 %  1 of 4, 0.5 items/s, 6 s left, load");
  ProgressState state = List(10, 100, 60000);
  state.failed = 2;
  EXPECT_THAT(ProgressLine(state, 80), HasSubstr("10 of 100, 2 failed, 0.167 items/s, 9 min 00 s left"));
  EXPECT_THAT(ProgressLine(List(1, 1000, 36000), 80), HasSubstr("9 h 59 min left"));
}

TEST(ProgressText, TheTimeLeftIsKnownForListsOnceAnItemHasEnded) {
  EXPECT_FALSE(EtaMs(List(0, 1, 100)).has_value());
  EXPECT_FALSE(EtaMs(List(1, 1, 100)).has_value());
  EXPECT_FALSE(EtaMs(List(0, 3, 100)).has_value());
  EXPECT_EQ(EtaMs(List(1, 3, 100)), 200);
  EXPECT_EQ(EtaMs(List(3, 3, 100)), 0);
}

TEST(ProgressText, JsonHasSixKeysOnOneLine) {
  const nlohmann::json json = testing::ParseJson(ProgressJson(List(1, 3, 100.4)));
  EXPECT_EQ(
      json,
      nlohmann::json(
          {{"stage", "load"}, {"fraction", 0.5}, {"item", 2}, {"items", 3}, {"elapsed_ms", 100}, {"eta_ms", 201}}));
  EXPECT_TRUE(testing::ParseJson(ProgressJson(List(0, 3, 1)))["eta_ms"].is_null());
  EXPECT_THAT(ProgressJson(List(0, 3, 1)), Not(HasSubstr("\n")));
}

}  // namespace
}  // namespace voxelpipe::cli
