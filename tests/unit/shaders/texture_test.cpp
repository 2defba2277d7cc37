#include "shaders/texture/texture.h"

#include <algorithm>
#include <cmath>

#include "gtest/gtest.h"
#include "shaders/fragment/packed_normal.h"

namespace voxelpipe {
namespace {

// Two by two: black, white / red, blue, all opaque.
constexpr uint8_t kTwoByTwo[16] = {0, 0, 0, 255, 255, 255, 255, 255, 255, 0, 0, 255, 0, 0, 255, 255};

TextureView View(uint8_t wrap, bool nearest) {
  TextureView t;
  t.rgba = kTwoByTwo;
  t.width = t.height = 2;
  t.wrap_s = t.wrap_t = wrap;
  t.nearest = nearest;
  t.srgb = true;
  return t;
}

// At a scale that magnifies.
Vec4f SampleSrgb(const TextureView& t, const Vec2f& uv) {
  return SampleTexture(t, uv, 1);
}

TEST(SrgbTest, MatchesTheTransferFunction) {
  for (int i = 0; i < 256; ++i) {
    const double c = i / 255.0, linear = c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
    EXPECT_NEAR(SrgbToLinear(uint8_t(i)), linear, 1e-7) << i;
  }
}

TEST(TextureTest, OriginIsTopLeft) {
  const TextureView t = View(0, true);
  EXPECT_EQ(SampleSrgb(t, {0.25f, 0.25f}), (Vec4f{0, 0, 0, 1}));
  EXPECT_EQ(SampleSrgb(t, {0.75f, 0.25f}), (Vec4f{1, 1, 1, 1}));
  EXPECT_EQ(SampleSrgb(t, {0.25f, 0.75f}), (Vec4f{1, 0, 0, 1}));
}

TEST(TextureTest, BilinearBlendsInLinearLight) {
  EXPECT_EQ(SampleSrgb(View(2, false), {0.5f, 0.25f}), (Vec4f{0.5f, 0.5f, 0.5f, 1}));
  EXPECT_EQ(SampleSrgb(View(2, false), {0.25f, 0.25f}), (Vec4f{0, 0, 0, 1}));
}

TEST(TextureTest, LinearTexelsAreNotDecoded) {
  const uint8_t texel[4] = {51, 102, 153, 204};
  EXPECT_EQ(DecodeTexel(texel, false), (Vec4f{0.2f, 0.4f, 0.6f, 0.8f}));
  EXPECT_EQ(DecodeTexel(texel, true), (Vec4f{SrgbToLinear(51), SrgbToLinear(102), SrgbToLinear(153), 0.8f}));
}

// Levels of grey 0.25 and 0.75 over the 2x2 texels, as if the image had 4x4: what is sampled tells the level.
struct Pyramid {
  Vec4f mips[5] = {{}, {}, {}, {}, {0.75f, 0.75f, 0.75f, 1}};
  uint8_t texels[64] = {};
  TextureView view;
  explicit Pyramid(uint8_t filter) {
    std::fill(mips, mips + 4, Vec4f{0.25f, 0.25f, 0.25f, 1});
    view.rgba = texels;
    view.mips = mips;
    view.width = view.height = 4;
    view.levels = 3;
    view.mip_filter = filter;
  }
  float At(float texels_per_voxel) const { return SampleTexture(view, {0.3f, 0.6f}, texels_per_voxel).x; }
};

TEST(MipTest, LinearMixesTheLevelsNextToOneTexelAVoxel) {
  const Pyramid pyramid(2);
  EXPECT_EQ(pyramid.At(0.1f), 0);
  EXPECT_EQ(pyramid.At(1), 0);
  EXPECT_EQ(pyramid.At(1.5f), 0.125f);
  EXPECT_EQ(pyramid.At(2), 0.25f);
  EXPECT_EQ(pyramid.At(3), 0.5f);
  EXPECT_EQ(pyramid.At(4), 0.75f);
  EXPECT_EQ(pyramid.At(1e30f), 0.75f);
  EXPECT_EQ(pyramid.At(INFINITY), 0.75f);
  EXPECT_EQ(pyramid.At(NAN), 0);
}

TEST(MipTest, NearestTakesOneLevel) {
  const Pyramid pyramid(1);
  EXPECT_EQ(pyramid.At(1.41f), 0);
  EXPECT_EQ(pyramid.At(1.42f), 0.25f);
  EXPECT_EQ(pyramid.At(2.82f), 0.25f);
  EXPECT_EQ(pyramid.At(2.84f), 0.75f);
}

TEST(MipTest, WithoutMipsTheImageAloneServes) {
  const Pyramid pyramid(0);
  EXPECT_EQ(pyramid.At(4), 0);
}

TEST(MipTest, MinificationHasItsOwnFilter) {
  TextureView t = View(2, true);  // nearest where it magnifies
  EXPECT_EQ(SampleTexture(t, {0.5f, 0.25f}, 1).x, 1);
  EXPECT_EQ(SampleTexture(t, {0.5f, 0.25f}, 1.01f).x, 0.5f);
  t.min_nearest = true;
  EXPECT_EQ(SampleTexture(t, {0.5f, 0.25f}, 1.01f).x, 1);
}

TEST(TextureTest, WrapModes) {
  for (const int64_t i : {-5, -2, -1, 0, 1, 2, 3, 7}) {
    EXPECT_EQ(WrapTexel(i, 2, 0), uint32_t(((i % 2) + 2) % 2)) << i;
    EXPECT_EQ(WrapTexel(i, 2, 2), uint32_t(i < 0 ? 0 : i > 1 ? 1 : i)) << i;
  }
  const uint32_t mirrored[] = {1, 0, 0, 1, 1, 0};  // -2 .. 3
  for (int i = -2; i <= 3; ++i) EXPECT_EQ(WrapTexel(i, 2, 1), mirrored[i + 2]) << i;
}

TEST(TextureTest, CoordinatesThatAreNoNumbersAreSafe) {
  for (const float bad : {NAN, INFINITY, -INFINITY, 3e38f}) SampleSrgb(View(0, false), {bad, bad});
  EXPECT_EQ(SampleSrgb(TextureView{}, {0.5f, 0.5f}), (Vec4f{1, 1, 1, 1}));
}

TEST(PackedNormalTest, OctahedralCorners) {
  const auto pack = [](float x, float y, float z) { return PackNormal({x, y, z}); };
  EXPECT_EQ(pack(0, 0, 1), (128u << 8) | 128u);
  EXPECT_EQ(pack(1, 0, 0), (255u << 8) | 128u);
  EXPECT_EQ(pack(-1, 0, 0), 128u);
  EXPECT_EQ(pack(0, 1, 0), (128u << 8) | 255u);
  EXPECT_EQ(pack(0, 0, -1), (255u << 8) | 255u);  // folded to the corner
  EXPECT_EQ(pack(0, 0, 0), (128u << 8) | 128u);   // no normal
}

}  // namespace
}  // namespace voxelpipe
