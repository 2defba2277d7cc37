#include "encode/preview/preview_slice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using testing::AddBits;
using testing::AddFloats;
using testing::BitFormula;
using testing::EmptyResult;
using testing::ValueFormula;

constexpr int kColumnWidth = 200, kColumnHeight = 600;  // pixels

Picture Slices(const VoxelizeResult& result) {
  const PreviewVolume volume = PreviewVolume::Build(result, nullptr).value();
  Canvas canvas(kColumnWidth, kColumnHeight, FromSrgb(0xe9edf1));
  const PixelRect column{0, 0, kColumnWidth, kColumnHeight};
  const absl::Status drawn = DrawSlices(volume, PreviewColours(result, volume), result.grid, column, nullptr, canvas);
  EXPECT_TRUE(drawn.ok()) << drawn;
  return canvas.ToPicture();
}

BitFormula RoundBody(double radius) {
  return [=](int64_t i, int64_t j, int64_t k) {
    return std::hypot(double(i) - 15.5, double(j) - 15.5, double(k) - 15.5) <= radius;
  };
}

VoxelizeResult Coloured(const BitFormula& bits, const ValueFormula& colour) {
  VoxelizeResult result = EmptyResult({32, 32, 32});
  AddBits(result, bits);
  AddFloats(result, 3, colour, "base_color");
  return result;
}

int Grey(const Picture& picture, size_t n) {
  return (int(picture.rgb[3 * n]) + int(picture.rgb[3 * n + 1]) + int(picture.rgb[3 * n + 2])) / 3;
}

bool Near(const Picture& picture, size_t n, const Vec3f& linear, int tolerance) {
  for (int c = 0; c < 3; ++c) {
    const float value = linear[c] <= 0.0031308f ? 12.92f * linear[c] : 1.055f * std::pow(linear[c], 1 / 2.4f) - 0.055f;
    if (std::abs(int(picture.rgb[3 * n + size_t(c)]) - int(std::lround(255 * value))) > tolerance) return false;
  }
  return true;
}

// The pixels in which a black body's slices differ from those of an empty grid, and those that stay paper.
struct SlicePixels {
  std::vector<size_t> body, paper;
};
SlicePixels PixelsOf(const BitFormula& bits) {
  const auto black = [](int64_t, int64_t, int64_t, int) { return 0.001f; };
  const Picture empty = Slices(Coloured([](int64_t, int64_t, int64_t) { return false; }, black));
  const Picture drawn = Slices(Coloured(bits, black));
  SlicePixels pixels;
  for (size_t n = 0; n < size_t(kColumnWidth) * kColumnHeight; ++n) {
    if (Grey(empty, n) - Grey(drawn, n) > 128) {
      pixels.body.push_back(n);
    } else if (Grey(empty, n) == 255 && Grey(drawn, n) == 255) {
      pixels.paper.push_back(n);
    }
  }
  return pixels;
}

TEST(DrawSlices, AWhiteMeshIsVisible) {
  const BitFormula shell = [](int64_t i, int64_t j, int64_t k) {
    return RoundBody(14)(i, j, k) && !RoundBody(12)(i, j, k);
  };
  for (const BitFormula& bits : {RoundBody(14), shell}) {
    const SlicePixels pixels = PixelsOf(bits);
    ASSERT_GT(pixels.body.size(), 1000u);
    ASSERT_GT(pixels.paper.size(), 1000u);
    const Picture white = Slices(Coloured(bits, [](int64_t, int64_t, int64_t, int) { return 1.0f; }));
    for (const size_t n : pixels.body) ASSERT_GT(Grey(white, n), 150) << n % kColumnWidth << "," << n / kColumnWidth;
    for (const size_t n : pixels.paper) ASSERT_LT(Grey(white, n), 80) << n % kColumnWidth << "," << n / kColumnWidth;
  }
}

TEST(DrawSlices, AWhiteAndBlackMeshIsVisibleInBothParts) {
  const SlicePixels pixels = PixelsOf(RoundBody(14));
  const Picture picture = Slices(
      Coloured(RoundBody(14), [](int64_t i, int64_t, int64_t k, int) { return (i + k) % 16 < 8 ? 1.0f : 0.001f; }));
  const int paper = Grey(picture, pixels.paper.front());
  size_t bright = 0, dark = 0;
  for (const size_t n : pixels.body) {
    bright += Grey(picture, n) > paper + 60 ? 1 : 0;
    dark += Grey(picture, n) < paper - 60 ? 1 : 0;
  }
  EXPECT_GT(bright, pixels.body.size() / 3);
  EXPECT_GT(dark, pixels.body.size() / 3);
}

TEST(DrawSlices, TheInsideOfASolidHasItsOwnColourAndNotThatOfClear) {
  const auto surface = [](int64_t i, int64_t j, int64_t k) {
    const BitFormula body = RoundBody(14.5);
    return !(body(i - 1, j, k) && body(i + 1, j, k) && body(i, j - 1, k) && body(i, j + 1, k) && body(i, j, k - 1) &&
             body(i, j, k + 1));
  };
  const SlicePixels pixels = PixelsOf(RoundBody(14.5));
  // As a fill leaves it: the inside holds `clear`, here 0.
  const Picture filled = Slices(Coloured(RoundBody(14.5), [&](int64_t i, int64_t j, int64_t k, int c) {
    return surface(i, j, k) && c == 0 ? 0.8f : 0.0f;
  }));
  size_t inside = 0, red = 0, black = 0;
  for (const size_t n : pixels.body) {
    inside += Near(filled, n, InsideColour(), 3) ? 1 : 0;
    red += filled.rgb[3 * n] > 200 && filled.rgb[3 * n + 1] < 60 ? 1 : 0;
    black += Grey(filled, n) < 40 ? 1 : 0;
  }
  EXPECT_GT(inside, pixels.body.size() / 2);
  EXPECT_GT(red, pixels.body.size() / 20);
  EXPECT_EQ(black, 0u);
  // A colour that a user gives to the inside is shown, and so is a black surface.
  const Picture green = Slices(Coloured(RoundBody(14.5), [&](int64_t i, int64_t j, int64_t k, int c) {
    return surface(i, j, k) ? 0.0f : c == 1 ? 0.8f : 0.0f;
  }));
  size_t green_inside = 0, black_outside = 0;
  for (const size_t n : pixels.body) {
    green_inside += green.rgb[3 * n + 1] > 200 && green.rgb[3 * n] < 60 ? 1 : 0;
    black_outside += Grey(green, n) < 40 ? 1 : 0;
    EXPECT_FALSE(Near(green, n, InsideColour(), 3));
  }
  EXPECT_GT(green_inside, pixels.body.size() / 2);
  EXPECT_GT(black_outside, pixels.body.size() / 20);
}

// The pixels of an axis's colour among the rows of a third of the column, by column.
std::map<int, int> AxisPixels(const Picture& picture, int third, int axis) {
  std::map<int, int> found;
  for (int y = third * kColumnHeight / 3; y < (third + 1) * kColumnHeight / 3; ++y) {
    for (int x = 0; x < kColumnWidth; ++x) {
      if (Near(picture, size_t(y * kColumnWidth + x), AxisColour(axis), 40)) ++found[x];
    }
  }
  return found;
}

TEST(DrawSlices, ArrowsPointAlongTheGridsAxes) {
  const Picture picture = Slices(Coloured(RoundBody(10), [](int64_t, int64_t, int64_t, int) { return 0.5f; }));
  // Slice, the axis across it, and whether that points to the left.
  for (const auto& [slice, axis, reversed] : {std::tuple{0, 2, true}, {1, 0, false}, {2, 0, false}}) {
    const std::map<int, int> found = AxisPixels(picture, slice, axis);
    ASSERT_GT(found.size(), 60u) << slice;
    const int first = found.begin()->first, last = found.rbegin()->first;
    int left = 0, right = 0;  // pixels in the ends: those with the head has more
    for (const auto& [x, count] : found) {
      if (x < first + 4) left += count;
      if (x > last - 4) right += count;
    }
    EXPECT_EQ(left > right, reversed) << slice << ": " << left << " " << right;
    EXPECT_NE(left, right);
  }
  for (const auto& [slice, axis] : {std::pair{0, 1}, {1, 2}, {2, 1}}) {
    int longest = 0;
    for (const auto& [x, count] : AxisPixels(picture, slice, axis)) longest = std::max(longest, count);
    EXPECT_GT(longest, 60) << slice;
  }
}

TEST(DrawSlices, RangesAreTheNumbersOfVoxels) {
  const auto empty = [](std::array<int64_t, 3> dims) {
    VoxelizeResult result = EmptyResult(dims);
    AddBits(result, [](int64_t, int64_t, int64_t) { return false; });
    return Slices(result).rgb;
  };
  // The same shape and captions of the same length: only the numbers differ.
  EXPECT_NE(empty({40, 40, 40}), empty({60, 60, 60}));
  EXPECT_NE(empty({40, 40, 41}), empty({40, 40, 40}));
  EXPECT_EQ(empty({40, 40, 40}), empty({40, 40, 40}));
  // Grids that leave no room for texts.
  for (const std::array<int64_t, 3> dims : {std::array<int64_t, 3>{1000000, 1, 1}, {1, 700, 1}, {1, 1, 300}}) {
    EXPECT_EQ(empty(dims).size(), size_t(3 * kColumnWidth * kColumnHeight));
  }
}

}  // namespace
}  // namespace voxelpipe
