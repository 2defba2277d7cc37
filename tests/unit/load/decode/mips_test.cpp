#include "load/decode/mips.h"

#include "gtest/gtest.h"
#include "mesh/views/mips.h"
#include "shaders/texture/srgb.h"

namespace voxelpipe {
namespace {

std::vector<uint8_t> Grey(const std::vector<uint8_t>& values) {
  std::vector<uint8_t> rgba;
  for (const uint8_t v : values) rgba.insert(rgba.end(), {v, v, v, 255});
  return rgba;
}

TEST(MipsTest, AFineCheckerboardBecomesItsMeanInLinearLight) {
  constexpr uint32_t kEdge = 256;
  std::vector<uint8_t> values;
  for (uint32_t i = 0; i < kEdge * kEdge; ++i) values.push_back((i % kEdge + i / kEdge) % 2 == 0 ? 255 : 0);
  const std::vector<Vec4f> mips = *BuildMips({}, Grey(values).data(), kEdge, kEdge, true);
  ASSERT_EQ(mips.size(), (kEdge * kEdge - 1) / 3);
  for (const Vec4f& texel : mips) ASSERT_EQ(texel, (Vec4f{0.5f, 0.5f, 0.5f, 1}));
}

TEST(MipsTest, SrgbIsDecodedBeforeItIsAveraged) {
  const std::vector<uint8_t> rgba = Grey({0, 188});
  EXPECT_EQ((*BuildMips({}, rgba.data(), 2, 1, true))[0].x, float(0.5 * double(SrgbToLinear(188))));
  EXPECT_EQ((*BuildMips({}, rgba.data(), 2, 1, false))[0].x, float(0.5 * double(188.0f / 255.0f)));
}

TEST(MipsTest, OddEdgesTakeThreeTexelsByTheirShares) {
  const std::vector<uint8_t> rgba = Grey({255, 0, 0, 0, 255});
  const std::vector<Vec4f> mips = *BuildMips({}, rgba.data(), 5, 1, false);  // 5 -> 2 -> 1
  ASSERT_EQ(mips.size(), 3u);
  EXPECT_FLOAT_EQ(mips[0].x, 0.4f);  // one of two and a half
  EXPECT_FLOAT_EQ(mips[1].x, 0.4f);
  EXPECT_FLOAT_EQ(mips[2].x, 0.4f);  // the mean of all
}

TEST(MipsTest, EveryLevelKeepsTheMean) {
  constexpr uint32_t kWidth = 13, kHeight = 6;
  std::vector<uint8_t> values;
  double mean = 0;
  for (uint32_t i = 0; i < kWidth * kHeight; ++i) {
    values.push_back(uint8_t(i * 97 % 251));
    mean += values.back() / 255.0 / (kWidth * kHeight);
  }
  const std::vector<Vec4f> mips = *BuildMips({}, Grey(values).data(), kWidth, kHeight, false);
  const uint32_t levels = CountLevels(kWidth, kHeight);
  EXPECT_EQ(levels, 4u);
  for (uint32_t level = 1; level < levels; ++level) {
    const uint64_t texels = uint64_t{LevelEdge(kWidth, level)} * LevelEdge(kHeight, level);
    double sum = 0;
    for (uint64_t i = 0; i < texels; ++i) sum += mips[LevelOffset(kWidth, kHeight, level) + i].x;
    EXPECT_NEAR(sum / double(texels), mean, 1e-6) << "level " << level;
  }
}

TEST(MipsTest, ASingleTexelHasNone) {
  EXPECT_TRUE(BuildMips({}, Grey({7}).data(), 1, 1, true)->empty());
}

}  // namespace
}  // namespace voxelpipe
