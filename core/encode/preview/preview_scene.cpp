// Light that reaches a point by a few cones through the density pyramid: C. Crassin et al., "Interactive Indirect
// Illumination Using Voxel Cone Tracing", Pacific Graphics 2011, reduced to occlusion.
#include "encode/preview/preview_scene.h"

#include <algorithm>
#include <cmath>

namespace voxelpipe {

Vec3d RelativeVoxelSize(const GridSpec& grid) {
  const Vec3d& h = grid.voxel_size;
  const double smallest = std::min({h.x, h.y, h.z});
  Vec3d relative;
  for (int a = 0; a < 3; ++a) relative[a] = std::clamp(h[a] / smallest, 1.0, 1000.0);
  return relative;
}

PreviewScene::PreviewScene(const PreviewCells& cells, const GridSpec& grid, const PreviewView& view,
                           const PixelRect& rect, const JobContext* job)
    : cells_(cells), rect_(rect), scale_(RelativeVoxelSize(grid)), frame_(FrameOf(view)) {
  inverse_ = {1 / scale_.x, 1 / scale_.y, 1 / scale_.z};
  ground_share_ = SmoothStep(0.05, 0.25, frame_.eye.y);
  light_ = Unit(frame_.right * -0.55 + frame_.up * 0.75 + frame_.eye * 0.62);
  for (size_t i = 0; i < kLights; ++i) {
    const double angle = 2.399963229728653 * double(i);  // the golden angle
    const size_t ring = (5 * i + 9) % kLights;           // near and far ones alternate
    const double spread = 0.07 * std::sqrt((double(ring) + 0.5) / double(kLights));
    lights_[i] = Unit(light_ + frame_.right * (spread * std::cos(angle)) + frame_.up * (spread * std::sin(angle)));
  }
  Fit();
  FindDepths(job);
}

PreviewScene::Shown PreviewScene::Show(const Vec3d& low, const Vec3d& high) const {
  Shown box;
  for (int a = 0; a < 3; ++a) {
    const double middle = (low[a] + high[a]) * 0.5 * scale_[a] - centre_[a];
    const double extent = (high[a] - low[a]) * 0.5 * scale_[a];
    box.x += frame_.right[a] * middle;
    box.y += frame_.up[a] * middle;
    box.across += std::abs(frame_.right[a]) * extent;
    box.along += std::abs(frame_.up[a]) * extent;
    box.near += frame_.eye[a] * middle + std::abs(frame_.eye[a]) * extent;
  }
  return box;
}

void PreviewScene::Fit() {
  middle_x_ = rect_.x + rect_.width / 2.0;
  middle_y_ = rect_.y + rect_.height / 2.0;
  Vec3d low, high;
  for (int a = 0; a < 3; ++a) {
    low[a] = double(cells_.lo()[size_t(a)]) * scale_[a];
    high[a] = double(cells_.hi()[size_t(a)]) * scale_[a];
  }
  centre_ = (low + high) * 0.5;
  const Vec3d half = (high - low) * 0.5;
  radius_ = std::max(1.0, std::sqrt(Dot(half, half)));
  // The frame fits the solid voxels, not their box, which would leave half of an isometric picture empty.
  double left = 1e300, rightmost = -1e300, bottom = 1e300, top = -1e300;
  cells_.VisitCells([&](const Vec3d& cell_low, const Vec3d& cell_high) {
    const Shown cell = Show(cell_low, cell_high);
    left = std::min(left, cell.x - cell.across);
    rightmost = std::max(rightmost, cell.x + cell.across);
    bottom = std::min(bottom, cell.y - cell.along);
    top = std::max(top, cell.y + cell.along);
  });
  constexpr double kFilled = 0.8;  // of the rectangle
  pixels_ = kFilled * std::min(rect_.width / (rightmost - left), rect_.height / (top - bottom));
  middle_x_ -= pixels_ * (left + rightmost) / 2;
  middle_y_ += pixels_ * (bottom + top) / 2;
}

// For each tile of the picture the depth of its nearest cell with voxels, where its rays start.
void PreviewScene::FindDepths(const JobContext* job) {
  JobPoll poll(job);
  bool stopped = false;
  depth_columns_ = rect_.width / kDepthTile + 1;
  const int rows = rect_.height / kDepthTile + 1;
  depths_.assign(size_t(depth_columns_) * size_t(rows), kNothing);
  cells_.VisitCells([&](const Vec3d& low, const Vec3d& high) {
    if (stopped) return;
    const Shown cell = Show(low, high);
    const auto tile = [](double pixel, int limit) {
      return std::clamp(int(std::floor(pixel / kDepthTile)), 0, limit - 1);
    };
    constexpr double kSlack = 0.01;  // pixels
    const double x = cell.x * pixels_ + middle_x_ - rect_.x, across = cell.across * pixels_ + kSlack;
    const double y = middle_y_ - cell.y * pixels_ - rect_.y, along = cell.along * pixels_ + kSlack;
    const int left = tile(x - across, depth_columns_), right = tile(x + across, depth_columns_);
    stopped = !poll.Add(uint64_t(right - left + 1)).ok();
    for (int row = tile(y - along, rows); row <= tile(y + along, rows); ++row) {
      for (int column = left; column <= right; ++column) {
        double& depth = depths_[size_t(row) * size_t(depth_columns_) + size_t(column)];
        depth = std::max(depth, cell.near);
      }
    }
  });
}

double PreviewScene::Open(const Vec3d& point, const Vec3d& normal, double first_step) const {
  const Vec3d side = Unit(Cross(normal, std::abs(normal.y) < 0.9 ? Vec3d{0, 1, 0} : Vec3d{1, 0, 0}));
  const Vec3d other = Cross(normal, side);
  const std::array<Vec3d, 5> cones = {normal, Unit(normal + side * 1.2), Unit(normal - side * 1.2),
                                      Unit(normal + other * 1.2), Unit(normal - other * 1.2)};
  const double fade = 1 / radius_;
  double open = 0;
  for (const Vec3d& cone : cones) {
    double through = 1, distance = first_step;
    for (int level = 0; level < cells_.levels() && distance < radius_ && through > 0.02; ++level) {
      const double density = cells_.Density(level, ToIndex(point + cone * distance));
      through *= 1 - std::min(1.0, 1.3 * density) * (1 - distance * fade);
      distance = std::max(distance * 1.8, 1.1 * cells_.CellSize(level + 1));
    }
    open += through;
  }
  return open / double(cones.size());
}

}  // namespace voxelpipe
