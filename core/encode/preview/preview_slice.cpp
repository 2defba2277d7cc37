#include "encode/preview/preview_slice.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "encode/preview/preview_scene.h"

namespace voxelpipe {
namespace {

// The grid axes to the right and upwards, and their directions.
struct SliceAxes {
  int across, upwards;
  bool across_reversed, upwards_reversed;
};
constexpr std::array<SliceAxes, 3> kAxes = {{{2, 1, true, false}, {0, 2, false, true}, {0, 1, false, false}}};
constexpr std::array<const char*, 3> kNames = {"x", "y", "z"};

struct Slice {
  int axis = 0;
  int64_t index = 0;  // along the axis
  int dot = 1;        // of texts, pixels
  int caption_y = 0;
  PixelRect image;
  struct Pixel {
    Vec3f colour;     // mean of the voxels, linear RGB
    float share = 0;  // opacity of the voxels
  };
  std::vector<Pixel> pixels;
};

// Places the image of a slice inside `rect`, with room for its caption and its axes.
Slice Place(const PreviewVolume& volume, const Vec3d& size, int axis, const PixelRect& rect) {
  const SliceAxes& axes = kAxes[size_t(axis)];
  const int64_t columns = volume.dims()[size_t(axes.across)], rows = volume.dims()[size_t(axes.upwards)];
  Slice slice;
  slice.axis = axis;
  slice.index = volume.dims()[size_t(axis)] / 2;
  slice.dot = std::max(1, rect.height / 130);
  const int dot = slice.dot, text = Canvas::TextHeight(dot);
  const int above = text + 3 * dot, below = text + 6 * dot;
  const int beside = std::min(rect.width / 3, Canvas::TextWidth(dot, absl::StrCat(rows)) + 6 * dot);
  const int free_width = std::max(1, rect.width - beside), free_height = std::max(1, rect.height - above - below);
  const double extent_across = double(columns) * size[axes.across], extent_up = double(rows) * size[axes.upwards];
  const double pixels = std::min(free_width / extent_across, free_height / extent_up);
  slice.image.width = std::clamp(int(extent_across * pixels + 0.5), 1, free_width);
  slice.image.height = std::clamp(int(extent_up * pixels + 0.5), 1, free_height);
  slice.image.x = rect.x + beside + (free_width - slice.image.width) / 2;
  slice.image.y = rect.y + above + (free_height - slice.image.height) / 2;
  slice.caption_y = slice.image.y - above;
  return slice;
}

absl::Status Sample(const PreviewVolume& volume, const PreviewColours& colours, const JobContext* job, Slice& slice) {
  const SliceAxes& axes = kAxes[size_t(slice.axis)];
  const int64_t columns = volume.dims()[size_t(axes.across)], rows = volume.dims()[size_t(axes.upwards)];
  const int width = slice.image.width, height = slice.image.height;
  slice.pixels.resize(size_t(width) * size_t(height));
  // Sample points of a pixel per direction: enough to hit each of up to 8 voxels under it.
  const int points_across = int(std::clamp<int64_t>(columns / width + 1, 2, 8));
  const int points_up = int(std::clamp<int64_t>(rows / height + 1, 2, 8));
  std::atomic<bool> stopped{false};
  tbb::parallel_for(tbb::blocked_range<int>(0, height, 16), [&](const auto& range) {
    JobPoll poll(job);
    for (int y = range.begin(); y < range.end(); ++y) {
      if (stopped) return;
      for (int x = 0; x < width; ++x) {
        if (!poll.Add(uint64_t(points_across * points_up)).ok()) stopped = true;
        Vec3f sum;
        int solid = 0;
        for (int point = 0; point < points_across * points_up; ++point) {
          const double u = (x + (point % points_across + 0.5) / points_across) / width;
          const double v = (y + (point / points_across + 0.5) / points_up) / height;  // from the top
          std::array<int64_t, 3> voxel;
          voxel[size_t(slice.axis)] = slice.index;
          voxel[size_t(axes.across)] =
              std::min(columns - 1, int64_t((axes.across_reversed ? 1 - u : u) * double(columns)));
          voxel[size_t(axes.upwards)] = std::min(rows - 1, int64_t((axes.upwards_reversed ? v : 1 - v) * double(rows)));
          if (!volume.Solid(voxel[0], voxel[1], voxel[2])) continue;
          sum = sum + colours.At(volume.Linear(voxel[0], voxel[1], voxel[2]));
          ++solid;
        }
        if (solid == 0) continue;
        // The square root keeps the thin lines of a hollow shell visible where many voxels share a pixel.
        slice.pixels[size_t(y) * size_t(width) + size_t(x)] = {
            sum * (1 / float(solid)), std::sqrt(float(solid) / float(points_across * points_up))};
      }
    }
  });
  return stopped ? job->Check() : absl::OkStatus();
}

// Whether an eye tells the colours apart.
bool StandsOut(const Vec3f& colour, const Vec3f& paper) {
  for (int c = 0; c < 3; ++c) {
    if (std::abs(std::sqrt(std::max(0.0f, colour[c])) - std::sqrt(paper[c])) > 0.3f) return true;
  }
  return false;
}

// White if it shows at least 98 % of the pixels with voxels, otherwise the tone that shows most of them.
Vec3f ChoosePaper(const std::array<Slice, 3>& slices) {
  static const std::array<Vec3f, 3> papers = {FromSrgb(0xffffff), FromSrgb(0x2f3844), FromSrgb(0x8d97a3)};
  std::array<uint64_t, 3> hidden{};
  uint64_t all = 0;
  for (const Slice& slice : slices) {
    for (const Slice::Pixel& pixel : slice.pixels) {
      if (!(pixel.share > 0)) continue;
      ++all;
      for (size_t i = 0; i < papers.size(); ++i) hidden[i] += StandsOut(pixel.colour, papers[i]) ? 0 : 1;
    }
  }
  if (50 * hidden[0] <= all) return papers[0];
  return papers[size_t(std::min_element(hidden.begin(), hidden.end()) - hidden.begin())];
}

// An arrow beside the image along one of its edges, with the axis's letter in the middle and its range at the ends.
void DrawAxis(const Slice& slice, int axis, int64_t voxels, bool upwards, bool reversed, Canvas& canvas) {
  static const Vec3f ink = FromSrgb(0x5b6675);
  const PixelRect& image = slice.image;
  const int dot = slice.dot, text = Canvas::TextHeight(dot);
  const double gap = 1.5 * dot, head = 2.5 * dot, line = std::max(1.0, 0.75 * dot);
  const std::string count = absl::StrCat(voxels);
  const int count_width = Canvas::TextWidth(dot, count), letter_width = Canvas::TextWidth(dot, "x");
  if (upwards) {
    const double x = image.x - gap, top = image.y, bottom = image.y + image.height;
    const double tip = reversed ? bottom : top, turn = reversed ? -1 : 1;
    canvas.Line(x, top, x, bottom, line, AxisColour(axis));
    for (const int side : {-1, 1})
      canvas.Line(x, tip, x + side * head * 0.7, tip + turn * head, line, AxisColour(axis));
    const int right = image.x - 5 * dot, low = image.y + image.height - text;  // where the numbers end
    if (image.height >= 2 * text + dot) {
      canvas.Text(right - count_width, reversed ? low : image.y, dot, count, ink);
      canvas.Text(right - letter_width, reversed ? image.y : low, dot, "0", ink);
    }
    const bool room = image.height >= 3 * text + 4 * dot;
    if (room || image.height < 2 * text + dot) {
      canvas.Text(right - letter_width, image.y + (image.height - text) / 2, dot, kNames[size_t(axis)],
                  AxisColour(axis));
    }
    return;
  }
  const double y = image.y + image.height + gap, left = image.x, right = image.x + image.width;
  const double tip = reversed ? left : right, turn = reversed ? 1 : -1;
  canvas.Line(left, y, right, y, line, AxisColour(axis));
  for (const int side : {-1, 1}) canvas.Line(tip, y, tip + turn * head, y + side * head * 0.7, line, AxisColour(axis));
  const int below = image.y + image.height + 5 * dot, end = image.x + image.width;
  if (image.width >= count_width + letter_width + 2 * dot) {
    canvas.Text(reversed ? image.x : end - count_width, below, dot, count, ink);
    canvas.Text(reversed ? end - letter_width : image.x, below, dot, "0", ink);
  }
  const bool room = image.width >= 2 * count_width + 2 * letter_width + 4 * dot;
  if (room || image.width < count_width + letter_width + 2 * dot) {
    canvas.Text(image.x + (image.width - letter_width) / 2, below, dot, kNames[size_t(axis)], AxisColour(axis));
  }
}

void Draw(const PreviewVolume& volume, const Slice& slice, const Vec3f& paper, Canvas& canvas) {
  static const Vec3f frame = FromSrgb(0xc3cad3), ink = FromSrgb(0x5b6675);
  const PixelRect& image = slice.image;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const Slice::Pixel& pixel = slice.pixels[size_t(y) * size_t(image.width) + size_t(x)];
      canvas.At(image.x + x, image.y + y) = paper + (pixel.colour - paper) * pixel.share;
    }
  }
  const double x0 = image.x - 0.5, y0 = image.y - 0.5, x1 = image.x + image.width + 0.5,
               y1 = image.y + image.height + 0.5;
  for (const auto& [ax, ay, bx, by] : {std::array{x0, y0, x1, y0}, std::array{x1, y0, x1, y1},
                                       std::array{x1, y1, x0, y1}, std::array{x0, y1, x0, y0}}) {
    canvas.Line(ax, ay, bx, by, 1, frame);
  }
  const SliceAxes& axes = kAxes[size_t(slice.axis)];
  DrawAxis(slice, axes.across, volume.dims()[size_t(axes.across)], false, axes.across_reversed, canvas);
  DrawAxis(slice, axes.upwards, volume.dims()[size_t(axes.upwards)], true, axes.upwards_reversed, canvas);
  canvas.Text(image.x, slice.caption_y, slice.dot, absl::StrCat(kNames[size_t(slice.axis)], " = ", slice.index), ink);
}

}  // namespace

absl::Status DrawSlices(const PreviewVolume& volume, const PreviewColours& colours, const GridSpec& grid,
                        const PixelRect& column, const JobContext* job, Canvas& canvas) {
  const uint64_t pixels = uint64_t(column.width) * uint64_t(column.height);
  MemoryCharge memory(&MemoryOf(job));
  if (absl::Status s = memory.Grow(pixels, sizeof(Slice::Pixel), "slices:"); !s.ok()) return s;
  const Vec3d size = RelativeVoxelSize(grid);
  const int margin = std::max(2, column.width / 16);
  const int height = (column.height - 4 * margin) / 3;
  std::array<Slice, 3> slices;
  for (int axis = 0; axis < 3; ++axis) {
    const PixelRect rect{column.x + margin, column.y + margin + axis * (height + margin), column.width - 2 * margin,
                         height};
    slices[size_t(axis)] = Place(volume, size, axis, rect);
    if (absl::Status s = Sample(volume, colours, job, slices[size_t(axis)]); !s.ok()) return s;
  }
  const Vec3f paper = ChoosePaper(slices);
  for (const Slice& slice : slices) Draw(volume, slice, paper, canvas);
  return absl::OkStatus();
}

}  // namespace voxelpipe
