// Texture sampling in our own arithmetic, so that both devices filter to the same bits.
//
// Source: glTF 2.0 specification, sections 3.8.4 (samplers) and 3.9.2 (base colour is sRGB); KHR_texture_transform;
// L. Williams, "Pyramidal Parametrics", SIGGRAPH 1983 (mip maps).
#pragma once

#include <cmath>

#include "mesh/views/mesh_view.h"
#include "mesh/views/mips.h"
#include "shaders/texture/srgb.h"

namespace voxelpipe {

// Texel coordinate of an unbounded index under a wrap mode (0 repeat, 1 mirrored repeat, 2 clamp to edge).
VOXELPIPE_HD uint32_t WrapTexel(int64_t i, uint32_t size, uint8_t mode) {
  const int64_t n = size;
  if (i >= 0 && i < n) return uint32_t(i);
  if (mode == 2) return i < 0 ? 0 : size - 1;
  const int64_t period = mode == 1 ? 2 * n : n;
  int64_t r = i % period;
  if (r < 0) r += period;
  return uint32_t(r < n ? r : period - 1 - r);
}

// Decodes a texel of level 0: four bytes to linear RGBA, the colour from sRGB if `srgb`.
VOXELPIPE_HD Vec4f DecodeTexel(const uint8_t* p, bool srgb) {
  const float alpha = float(p[3]) / 255.0f;
  if (srgb) return {SrgbToLinear(p[0]), SrgbToLinear(p[1]), SrgbToLinear(p[2]), alpha};
  return {float(p[0]) / 255.0f, float(p[1]) / 255.0f, float(p[2]) / 255.0f, alpha};
}

// One level of a texture, ready to be read.
struct TextureLevel {
  const uint8_t* rgba = nullptr;  // level 0, otherwise:
  const Vec4f* linear = nullptr;
  uint32_t width = 1, height = 1;
};

VOXELPIPE_HD TextureLevel LevelOf(const TextureView& t, uint32_t level) {
  if (level == 0) return {t.rgba, nullptr, t.width, t.height};
  return {nullptr, t.mips + LevelOffset(t.width, t.height, level), LevelEdge(t.width, level),
          LevelEdge(t.height, level)};
}

// Linear RGBA of a texel, its coordinates wrapped.
VOXELPIPE_HD_CALL Vec4f Fetch(const TextureView& t, const TextureLevel& level, int64_t x, int64_t y) {
  const uint64_t at =
      uint64_t{WrapTexel(y, level.height, t.wrap_t)} * level.width + WrapTexel(x, level.width, t.wrap_s);
  return level.linear != nullptr ? level.linear[at] : DecodeTexel(level.rgba + at * 4, t.srgb);
}

VOXELPIPE_HD Vec4f Lerp(const Vec4f& a, const Vec4f& b, float t) {
  return {a.x + (b.x - a.x) * t, a.y + (b.y - a.y) * t, a.z + (b.z - a.z) * t, a.w + (b.w - a.w) * t};
}

// One level, the nearest texel or bilinear.
VOXELPIPE_HD_CALL Vec4f SampleLevel(const TextureView& t, uint32_t level_index, const Vec2f& uv, bool nearest) {
  const TextureLevel level = LevelOf(t, level_index);
  double x = double(uv.x) * double(level.width), y = double(uv.y) * double(level.height);
  constexpr double kFar = 0x1p40;  // texels; also catches NaN and infinity
  if (!(Abs(x) < kFar)) x = 0;
  if (!(Abs(y) < kFar)) y = 0;
  if (nearest) return Fetch(t, level, int64_t(floor(x)), int64_t(floor(y)));
  x -= 0.5;
  y -= 0.5;
  const double fx = floor(x), fy = floor(y);
  const int64_t ix = int64_t(fx), iy = int64_t(fy);
  const float tx = float(x - fx), ty = float(y - fy);
  const Vec4f top = Lerp(Fetch(t, level, ix, iy), Fetch(t, level, ix + 1, iy), tx);
  const Vec4f bottom = Lerp(Fetch(t, level, ix, iy + 1), Fetch(t, level, ix + 1, iy + 1), tx);
  return Lerp(top, bottom, ty);
}

// In: texture coordinates, origin at the image's top left; the number of level-0 texels along a voxel. Out: linear
// RGBA.
//
// Up to one texel a voxel, the magnification filter reads level 0. Beyond, r texels lie between levels l and l + 1 with
// 2^l <= r < 2^(l+1): `linear` interpolates with the weight r / 2^l - 1, which equals log2(r) - l at both ends and
// needs no logarithm; `nearest` takes the level whose size is nearer by ratio (r up to sqrt(2) * 2^l: level l); `none`
// reads level 0. No image: white.
VOXELPIPE_HD Vec4f SampleTexture(const TextureView& t, const Vec2f& uv, float texels_per_voxel) {
  constexpr uint8_t kNone = 0, kNearest = 1;  // MipFilter
  if (t.width == 0) return {1, 1, 1, 1};
  if (!(texels_per_voxel > 1)) return SampleLevel(t, 0, uv, t.nearest);
  if (t.mip_filter == kNone || t.mips == nullptr) return SampleLevel(t, 0, uv, t.min_nearest);
  const uint32_t last = t.levels - 1;
  uint32_t level = 0;
  float rest = texels_per_voxel;
  while (level < last && rest >= 2) {
    rest *= 0.5f;
    ++level;
  }
  if (level == last) return SampleLevel(t, last, uv, t.min_nearest);
  if (t.mip_filter == kNearest) return SampleLevel(t, rest * rest < 2 ? level : level + 1, uv, t.min_nearest);
  return Lerp(SampleLevel(t, level, uv, t.min_nearest), SampleLevel(t, level + 1, uv, t.min_nearest), rest - 1);
}

}  // namespace voxelpipe
