#include "encode/preview/preview_canvas.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "encode/preview/preview_glyphs.h"

namespace voxelpipe {
namespace {

float ToLinear(float s) {
  return s <= 0.04045f ? s / 12.92f : std::pow((s + 0.055f) / 1.055f, 2.4f);
}

float ToSrgb(float l) {
  l = std::clamp(l, 0.0f, 1.0f);
  return l <= 0.0031308f ? 12.92f * l : 1.055f * std::pow(l, 1 / 2.4f) - 0.055f;
}

}  // namespace

Vec3f FromSrgb(unsigned rgb) {
  return {ToLinear(float(rgb >> 16 & 255) / 255), ToLinear(float(rgb >> 8 & 255) / 255),
          ToLinear(float(rgb & 255) / 255)};
}

Vec3f AxisColour(int axis) {
  static const std::array<Vec3f, 3> colours = {FromSrgb(0xc8414b), FromSrgb(0x3f9a4f), FromSrgb(0x3a6fd0)};
  return colours[size_t(axis)];
}

void Canvas::Blend(int x, int y, Vec3f colour, float opacity) {
  if (x < 0 || y < 0 || x >= width_ || y >= height_) return;
  Vec3f& pixel = At(x, y);
  pixel = pixel + (colour - pixel) * std::clamp(opacity, 0.0f, 1.0f);
}

void Canvas::Line(double x0, double y0, double x1, double y1, double width, Vec3f colour) {
  const double dx = x1 - x0, dy = y1 - y0, length2 = dx * dx + dy * dy;
  const int left = int(std::floor(std::min(x0, x1) - width)), right = int(std::ceil(std::max(x0, x1) + width));
  const int top = int(std::floor(std::min(y0, y1) - width)), bottom = int(std::ceil(std::max(y0, y1) + width));
  for (int y = top; y <= bottom; ++y) {
    for (int x = left; x <= right; ++x) {
      const double px = x + 0.5 - x0, py = y + 0.5 - y0;
      const double along = length2 > 0 ? std::clamp((px * dx + py * dy) / length2, 0.0, 1.0) : 0;
      const double distance = std::hypot(px - along * dx, py - along * dy);
      Blend(x, y, colour, float(width / 2 + 0.5 - distance));
    }
  }
}

void Canvas::Text(int x, int y, int dot, std::string_view text, Vec3f colour) {
  for (const char character : text) {
    for (const Glyph& glyph : kGlyphs) {
      if (glyph.character != character) continue;
      for (int row = 0; row < 7 * dot; ++row) {
        for (int column = 0; column < 5 * dot; ++column) {
          if (glyph.rows[size_t(row / dot)][column / dot] == '#') Blend(x + column, y + row, colour, 1);
        }
      }
    }
    x += 6 * dot;
  }
}

Picture Canvas::ToPicture(const JobContext* job) const {
  constexpr float kDither[4] = {-0.375f, 0.125f, 0.375f, -0.125f};
  // The curve at 4096 steps, finer than a tenth of a level: the picture has millions of values.
  static const auto table = [] {
    std::array<float, 4097> curve{};
    for (int i = 0; i <= 4096; ++i) curve[size_t(i)] = 255 * ToSrgb(float(i) / 4096 * (float(i) / 4096));
    return curve;
  }();
  Picture picture{width_, height_, std::vector<uint8_t>(pixels_.size() * 3)};
  tbb::parallel_for(tbb::blocked_range<int>(0, height_, 16), [&](const auto& rows) {
    if (job != nullptr && !job->Check().ok()) return;
    for (size_t n = size_t(rows.begin()) * size_t(width_); n < size_t(rows.end()) * size_t(width_); ++n) {
      const size_t x = n % size_t(width_), y = n / size_t(width_);
      const float dither = 0.5f + kDither[(x % 2) + 2 * (y % 2)];
      for (int c = 0; c < 3; ++c) {
        // Indexed by the square root, which gives the steep dark end of the curve more steps.
        const float value = table[size_t(4096 * std::sqrt(std::clamp(pixels_[n][c], 0.0f, 1.0f)) + 0.5f)];
        picture.rgb[3 * n + size_t(c)] = uint8_t(std::clamp(value + dither, 0.0f, 255.0f));
      }
    }
  });
  return picture;
}

}  // namespace voxelpipe
