#include "encode/preview/legend.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "encode/png_preview.h"
#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using testing::AddBits;
using testing::AddFloats;
using testing::AddHostileParts;
using testing::AddLabels;
using testing::AddParts;
using testing::EmptyResult;
using testing::HostileNames;

TEST(Legend, HasAnEntryALabel) {
  VoxelizeResult result = EmptyResult({1, 1, 1});
  EXPECT_TRUE(LegendOf(result.parts).empty());
  AddParts(result, {{5, "wing"}, {2, "tank"}, {5, "tip"}, {4'000'000'000u, ""}});
  const std::vector<LegendEntry> legend = LegendOf(result.parts);
  ASSERT_EQ(legend.size(), 3u);
  EXPECT_EQ(legend[0].label, 2u);
  EXPECT_EQ(legend[0].name, "tank");
  EXPECT_EQ(legend[1].name, "wing") << "of the first part with the label";
  EXPECT_EQ(legend[1].parts, 2u);
  EXPECT_EQ(legend[1].triangles, 10u + 12u);
  EXPECT_EQ(legend[1].voxels, 100u + 102u);
  EXPECT_EQ(legend[1].rgb, LabelColour(5));
  EXPECT_EQ(legend[2].label, 4'000'000'000u);
  AddHostileParts(result);
  const std::vector<LegendEntry> hostile = LegendOf(result.parts);
  for (size_t i = 0; i < hostile.size(); ++i) EXPECT_EQ(hostile[i].name, HostileNames()[i].second);
}

TEST(Legend, ColoursOfTheFirstLabelsDiffer) {
  EXPECT_EQ(LabelColour(1), 0xe69f00u);
  std::set<uint32_t> colours;
  for (uint32_t label = 1; label <= 200; ++label) colours.insert(LabelColour(label));
  EXPECT_EQ(colours.size(), 200u);
  for (const uint32_t colour : colours) EXPECT_LE(colour, 0xffffffu);
}

TEST(Legend, LabelsAreThoseThatABlendKeeps) {
  TargetSpec spec;
  spec.format = VoxelFormat::kU8;
  spec.shader = {"label", {}};
  for (const auto& [blend, holds] : {std::pair{Blend::kReplace, true},
                                     {Blend::kFirst, true},
                                     {Blend::kMin, true},
                                     {Blend::kMax, true},
                                     {Blend::kAdd, false},
                                     {Blend::kCount, false},
                                     {Blend::kOr, false},
                                     {Blend::kAverage, false}}) {
    spec.blend = blend;
    EXPECT_EQ(HoldsLabels(spec, ResultKind::kDense), holds);
    EXPECT_TRUE(HoldsLabels(spec, ResultKind::kBuckets));
  }
  spec.blend = Blend::kReplace;
  spec.shader.name = "mesh_id";
  EXPECT_FALSE(HoldsLabels(spec, ResultKind::kDense));
}

// Pixels of exactly this colour.
size_t Count(const Picture& picture, uint32_t rgb) {
  size_t count = 0;
  for (size_t n = 0; n < picture.rgb.size(); n += 3) {
    const uint32_t pixel = uint32_t(picture.rgb[n]) << 16 | uint32_t(picture.rgb[n + 1]) << 8 | picture.rgb[n + 2];
    count += pixel == rgb;
  }
  return count;
}

// Two halves with the labels 1 and 5.
VoxelizeResult Halves() {
  VoxelizeResult result = EmptyResult({16, 16, 16});
  AddLabels<uint32_t>(result, [](int64_t i, int64_t, int64_t) { return i < 8 ? 1u : 5u; });
  return result;
}

TEST(Legend, IsDrawnIntoPicturesOfLabels) {
  VoxelizeResult result = Halves();
  const PreviewOptions options{.width = 640, .height = 480};
  const Picture plain = RenderPreview(result, options).value();
  AddParts(result, {{1, "wing"}, {5, "tank"}});
  const Picture labelled = RenderPreview(result, options).value();
  // The dither leaves pixels of an even colour as they are, or a step beside.
  EXPECT_GE(Count(labelled, LabelColour(1)), 20u);
  EXPECT_GE(Count(labelled, LabelColour(5)), 20u);
  EXPECT_NE(plain.rgb, labelled.rgb);
  AddParts(result, {{1, "wing"}, {5, "hatch"}});
  EXPECT_NE(RenderPreview(result, options).value().rgb, labelled.rgb) << "the name is in the picture";
  AddHostileParts(result);
  EXPECT_TRUE(RenderPreview(result, options).ok());
  std::vector<testing::SamplePart> parts;
  for (uint32_t n = 1; n <= 65'535; ++n) parts.emplace_back(n, "part");
  AddParts(result, parts);
  for (const int side : {64, 480}) EXPECT_TRUE(RenderPreview(result, {.width = side, .height = side}).ok());
}

TEST(Legend, IsInNoPictureOfOtherColours) {
  const PreviewOptions options{.width = 320, .height = 240};
  VoxelizeResult result = EmptyResult({16, 16, 16});
  AddFloats(
      result, 3, [](int64_t i, int64_t, int64_t, int c) { return c == 0 ? float(i) / 16 : 0.5f; }, "base_color");
  AddLabels<uint8_t>(result, [](int64_t i, int64_t, int64_t) { return i < 8 ? 1u : 5u; });
  const Picture without = RenderPreview(result, options).value();
  AddParts(result, {{1, "wing"}, {5, "tank"}});
  EXPECT_EQ(RenderPreview(result, options).value().rgb, without.rgb);
}

TEST(Canvas, HasALetterForEachPrintableCharacter) {
  std::set<std::vector<uint8_t>> pictures;
  for (char c = ' '; c <= '~'; ++c) {
    Canvas canvas(8, 8, {1, 1, 1});
    canvas.Text(1, 1, 1, std::string_view(&c, 1), {0, 0, 0});
    EXPECT_TRUE(pictures.insert(canvas.ToPicture().rgb).second) << c;
  }
}

}  // namespace
}  // namespace voxelpipe
