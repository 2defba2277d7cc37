// A small drawing surface in linear light, for the preview.
#pragma once

#include <string_view>
#include <vector>

#include "base/job_context.h"
#include "base/vec.h"
#include "encode/preview/png_writer.h"

namespace voxelpipe {

// Linear red, green, blue of an sRGB colour written as 0xRRGGBB.
Vec3f FromSrgb(unsigned rgb);

// The colour of an axis, 0 = x: red, green, blue.
Vec3f AxisColour(int axis);

// A rectangle of the canvas, pixels.
struct PixelRect {
  int x = 0, y = 0, width = 0, height = 0;
};

class Canvas {
 public:
  Canvas(int width, int height, Vec3f colour) : width_(width), height_(height) {
    pixels_.resize(size_t(width) * size_t(height), colour);
  }

  int width() const { return width_; }
  int height() const { return height_; }
  Vec3f& At(int x, int y) { return pixels_[size_t(y) * size_t(width_) + size_t(x)]; }

  // Blends `colour` over the pixel; no effect outside the canvas.
  void Blend(int x, int y, Vec3f colour, float opacity);
  // A line of the given width in pixels, antialiased.
  void Line(double x0, double y0, double x1, double y1, double width, Vec3f colour);
  // Text of printable ASCII, 5x7 dots of `dot` pixels a glyph; (x, y) is the top left corner. Nothing is drawn for
  // other bytes.
  void Text(int x, int y, int dot, std::string_view text, Vec3f colour);
  static int TextWidth(int dot, std::string_view text) { return int(text.size()) * 6 * dot - dot; }
  static int TextHeight(int dot) { return 7 * dot; }

  // To 8-bit sRGB, with an ordered dither below one step so that smooth backgrounds show no bands.
  // Returns early at the end of `job`, which may be null: look at the job before use.
  Picture ToPicture(const JobContext* job = nullptr) const;

 private:
  int width_, height_;
  std::vector<Vec3f> pixels_;
};

}  // namespace voxelpipe
