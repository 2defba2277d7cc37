#include "encode/drawn/palette.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace voxelpipe {
namespace {

using ::testing::ElementsAre;
using ::testing::UnorderedElementsAre;

TEST(MakePalette, KeepsFewColoursAsTheyAre) {
  const Palette palette = MakePalette({{0xff0000, 9}, {0x0000ff, 1}, {0x102030, 4}}, 3, nullptr).value();
  EXPECT_THAT(palette.colours, ElementsAre(0x0000ff, 0x102030, 0xff0000));
  for (const uint32_t rgb : palette.colours) EXPECT_EQ(palette.colours[palette.nearest.at(rgb)], rgb);
  EXPECT_TRUE(MakePalette({}, 255, nullptr).value().colours.empty());
}

TEST(MakePalette, JoinsWhatIsNearWeightedByOccurrence) {
  const Palette palette = MakePalette({{0x000000, 1}, {0x000004, 3}, {0xf00000, 1}, {0xf80000, 1}}, 2, nullptr).value();
  EXPECT_THAT(palette.colours, UnorderedElementsAre(0x000003, 0xf40000));
  EXPECT_EQ(palette.nearest.at(0x000000), palette.nearest.at(0x000004));
  EXPECT_NE(palette.nearest.at(0x000000), palette.nearest.at(0xf00000));
}

TEST(MakePalette, ManyColoursBecomeExactlyAsManyAsAskedFor) {
  absl::flat_hash_map<uint32_t, uint64_t> occurrences;
  for (uint32_t i = 0; i < 20000; ++i) occurrences[i * 839 % 0x1000000] = 1 + i % 5;
  const Palette palette = MakePalette(occurrences, 255, nullptr).value();
  ASSERT_EQ(palette.colours.size(), 255u);
  ASSERT_EQ(palette.nearest.size(), occurrences.size());
  double worst = 0;
  for (const auto& [rgb, place] : palette.nearest) {
    const uint32_t other = palette.colours.at(place);
    for (const int shift : {0, 8, 16}) {
      worst = std::max(worst, std::abs(double((rgb >> shift) & 255) - double((other >> shift) & 255)));
    }
  }
  EXPECT_LT(worst, 64);  // 255 even boxes of the cube have sides of some 40
}

TEST(MakePalette, OneColourMayOccurMoreOftenThanAllOthers) {
  const Palette palette = MakePalette({{0, 1000000}, {1, 1}, {2, 1}, {0xffffff, 1}}, 3, nullptr).value();
  EXPECT_EQ(palette.colours.size(), 3u);
}

}  // namespace
}  // namespace voxelpipe
