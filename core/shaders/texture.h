// Texture sampling in our own arithmetic, so that both devices filter to the same bits.
//
// Source: glTF 2.0 specification, sections 3.8.4 (samplers) and 3.9.2 (base colour is sRGB); KHR_texture_transform.
#pragma once

#include <cmath>

#include "shaders/mesh_view.h"
#include "shaders/srgb.h"

namespace voxelpipe {

// Texel coordinate of an unbounded index under a wrap mode (0 repeat, 1 mirrored repeat, 2 clamp to edge).
VOXELPIPE_HD uint32_t WrapTexel(int64_t i, uint32_t size, uint8_t mode) {
  const int64_t n = size;
  if (mode == 2) return uint32_t(Clamp<int64_t>(i, 0, n - 1));
  const int64_t period = mode == 1 ? 2 * n : n;
  int64_t r = i % period;
  if (r < 0) r += period;
  return uint32_t(r < n ? r : period - 1 - r);
}

// One texel, colour decoded from sRGB to linear, alpha linear.
VOXELPIPE_HD Vec4f FetchSrgb(const TextureView& t, int64_t x, int64_t y) {
  const uint64_t at =
      (uint64_t(WrapTexel(y, t.height, t.wrap_t)) * t.width + WrapTexel(x, t.width, t.wrap_s)) * uint64_t{4};
  const uint8_t* p = t.rgba + at;
  return {SrgbToLinear(p[0]), SrgbToLinear(p[1]), SrgbToLinear(p[2]), float(p[3]) / 255.0f};
}

VOXELPIPE_HD Vec4f Lerp(const Vec4f& a, const Vec4f& b, float t) {
  return {a.x + (b.x - a.x) * t, a.y + (b.y - a.y) * t, a.z + (b.z - a.z) * t, a.w + (b.w - a.w) * t};
}

// In: texture coordinates, origin at the image's top left. Out: linear RGBA, bilinear or nearest.
VOXELPIPE_HD Vec4f SampleSrgb(const TextureView& t, const Vec2f& uv) {
  if (t.width == 0) return {1, 1, 1, 1};
  double x = double(uv.x) * double(t.width), y = double(uv.y) * double(t.height);
  constexpr double kFar = 0x1p40;  // texels; also catches NaN and infinity
  if (!(Abs(x) < kFar)) x = 0;
  if (!(Abs(y) < kFar)) y = 0;
  if (t.nearest) return FetchSrgb(t, int64_t(floor(x)), int64_t(floor(y)));
  x -= 0.5;
  y -= 0.5;
  const double fx = floor(x), fy = floor(y);
  const int64_t ix = int64_t(fx), iy = int64_t(fy);
  const float tx = float(x - fx), ty = float(y - fy);
  const Vec4f top = Lerp(FetchSrgb(t, ix, iy), FetchSrgb(t, ix + 1, iy), tx);
  const Vec4f bottom = Lerp(FetchSrgb(t, ix, iy + 1), FetchSrgb(t, ix + 1, iy + 1), tx);
  return Lerp(top, bottom, ty);
}

}  // namespace voxelpipe
