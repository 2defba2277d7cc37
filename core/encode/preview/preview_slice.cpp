#include "encode/preview/preview_slice.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

// The grid axes to the right and upwards, and their directions.
struct SliceAxes {
  int across, upwards;
  bool across_reversed, upwards_reversed;
};
constexpr std::array<SliceAxes, 3> kAxes = {{{2, 1, true, false}, {0, 2, false, true}, {0, 1, false, false}}};

}  // namespace

void DrawSlice(const PreviewVolume& volume, const PreviewColours& colours, const GridSpec& grid, int axis,
               const PixelRect& rect, Canvas& canvas) {
  static const Vec3f paper = FromSrgb(0xffffff), frame = FromSrgb(0xc3cad3), ink = FromSrgb(0x5b6675);
  const SliceAxes& axes = kAxes[size_t(axis)];
  const int64_t columns = volume.dims()[size_t(axes.across)], rows = volume.dims()[size_t(axes.upwards)];
  const int64_t slice = volume.dims()[size_t(axis)] / 2;
  const Vec3d size = RelativeVoxelSize(grid);
  const double extent_across = double(columns) * size[axes.across], extent_up = double(rows) * size[axes.upwards];

  const int dot = std::max(1, rect.height / 130);
  const int caption = Canvas::TextHeight(dot) + 3 * dot;
  const double pixels = std::min(rect.width / extent_across, (rect.height - caption) / extent_up);
  const int width = std::clamp(int(extent_across * pixels + 0.5), 1, rect.width);
  const int height = std::clamp(int(extent_up * pixels + 0.5), 1, rect.height - caption);
  const int left = rect.x + (rect.width - width) / 2, top = rect.y + caption + (rect.height - caption - height) / 2;

  // Sample points of a pixel per direction: enough to hit each of up to 8 voxels under it.
  const int points_across = int(std::clamp<int64_t>(columns / width + 1, 2, 8));
  const int points_up = int(std::clamp<int64_t>(rows / height + 1, 2, 8));
  tbb::parallel_for(tbb::blocked_range<int>(0, height, 16), [&](const auto& range) {
    for (int y = range.begin(); y < range.end(); ++y) {
      for (int x = 0; x < width; ++x) {
        Vec3f sum;
        int solid = 0;
        for (int point = 0; point < points_across * points_up; ++point) {
          const double u = (x + (point % points_across + 0.5) / points_across) / width;
          const double v = (y + (point / points_across + 0.5) / points_up) / height;  // from the top
          std::array<int64_t, 3> voxel;
          voxel[size_t(axis)] = slice;
          voxel[size_t(axes.across)] =
              std::min(columns - 1, int64_t((axes.across_reversed ? 1 - u : u) * double(columns)));
          voxel[size_t(axes.upwards)] = std::min(rows - 1, int64_t((axes.upwards_reversed ? v : 1 - v) * double(rows)));
          if (!volume.Solid(voxel[0], voxel[1], voxel[2])) continue;
          sum = sum + colours.At(volume.Linear(voxel[0], voxel[1], voxel[2]));
          ++solid;
        }
        Vec3f& pixel = canvas.At(left + x, top + y);
        pixel = paper;
        if (solid == 0) continue;
        // The square root keeps the thin lines of a hollow shell visible where many voxels share a pixel.
        const float share = std::sqrt(float(solid) / float(points_across * points_up));
        pixel = pixel + (sum * (0.9f / float(solid)) - pixel) * share;
      }
    }
  });

  const double x0 = left - 0.5, y0 = top - 0.5, x1 = left + width + 0.5, y1 = top + height + 0.5;
  for (const auto& [ax, ay, bx, by] : {std::array{x0, y0, x1, y0}, std::array{x1, y0, x1, y1},
                                       std::array{x1, y1, x0, y1}, std::array{x0, y1, x0, y0}}) {
    canvas.Line(ax, ay, bx, by, 1, frame);
  }
  constexpr std::array<const char*, 3> kNames = {"x", "y", "z"};
  canvas.Text(left, top - caption, dot, absl::StrCat(kNames[size_t(axis)], " = ", slice), ink);
}

}  // namespace voxelpipe
