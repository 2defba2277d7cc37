// The voxels before a camera: where they are in the picture, what a ray meets, and how much light reaches a point.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "base/vec.h"
#include "encode/preview/preview_canvas.h"
#include "encode/preview/preview_cells.h"
#include "encode/preview/preview_view.h"
#include "grid/grid_spec.h"

namespace voxelpipe {

// Voxel size per axis over the smallest one, limited to 1000 so that grids of needles can be drawn.
Vec3d RelativeVoxelSize(const GridSpec& grid);

// 0 up to `low`, 1 from `high` on, smooth between them.
inline double SmoothStep(double low, double high, double value) {
  const double t = std::clamp((value - low) / (high - low), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}
// `v` over its length; 0 if that is 0.
inline Vec3d Unit(const Vec3d& v) {
  const double length = std::sqrt(Dot(v, v));
  return length > 0 ? v * (1 / length) : v;
}

// Its constructor returns early at the end of `job`, which may be null: look at the job before use.
//
// "Scaled" space is index space times the relative voxel size: square, +Y up. Borrows the cells, which are not empty.
class PreviewScene {
 public:
  PreviewScene(const PreviewCells& cells, const GridSpec& grid, const PreviewView& view, const PixelRect& rect,
               const JobContext* job);

  const PreviewCells& cells() const { return cells_; }
  const Vec3d& scale() const { return scale_; }
  const ViewFrame& frame() const { return frame_; }
  // Towards the light, which stands above the viewer's left shoulder.
  const Vec3d& light() const { return light_; }
  // Directions within a small disc around the light, whose mean is a soft shadow. Any four in a row surround it.
  static constexpr size_t kLights = 16;
  const std::array<Vec3d, kLights>& lights() const { return lights_; }
  const Vec3d& centre() const { return centre_; }  // of the solid box, scaled
  double radius() const { return radius_; }        // of the solid box, scaled; at least 1
  double floor_height() const { return double(cells_.lo()[1]) * scale_.y; }
  double pixels() const { return pixels_; }  // a unit of scaled space
  // How much of the ground is shown: 0 for views from below or along it, 1 for views from well above.
  double ground_share() const { return ground_share_; }

  Vec3d ToIndex(const Vec3d& p) const { return {p.x * inverse_.x, p.y * inverse_.y, p.z * inverse_.z}; }
  // The point of the canvas, in pixels, on the plane through centre() that faces the viewer.
  Vec3d PointAt(double x, double y) const {
    return centre_ + frame_.right * ((x - middle_x_) / pixels_) + frame_.up * ((middle_y_ - y) / pixels_);
  }
  // A depth along frame().eye from centre() before which the rays through a pixel meet no voxel; kNothing if they meet
  // none at all.
  static constexpr double kNothing = -1e300;
  double NearestDepth(int x, int y) const {
    return depths_[size_t((y - rect_.y) / kDepthTile) * size_t(depth_columns_) + size_t((x - rect_.x) / kDepthTile)];
  }
  PreviewHit Trace(const Vec3d& origin, const Vec3d& direction, double length) const {
    return cells_.Trace(ToIndex(origin), ToIndex(direction), 0, length);
  }
  // The open share, 0 to 1, of the half space around `normal`; cones start `first_step` above the point.
  double Open(const Vec3d& point, const Vec3d& normal, double first_step) const;

 private:
  // The projection of a box, scaled and relative to centre_: its middle, half its extent, and its nearest depth.
  struct Shown {
    double x = 0, y = 0, across = 0, along = 0, near = 0;
  };
  Shown Show(const Vec3d& low, const Vec3d& high) const;
  void Fit();
  void FindDepths(const JobContext* job);

  const PreviewCells& cells_;
  PixelRect rect_;
  Vec3d scale_, inverse_;
  ViewFrame frame_;
  double ground_share_ = 0;
  Vec3d light_;
  std::array<Vec3d, kLights> lights_;
  Vec3d centre_;
  double radius_ = 1, pixels_ = 1;
  double middle_x_ = 0, middle_y_ = 0;  // centre_ in the picture, pixels
  static constexpr int kDepthTile = 4;  // pixels
  std::vector<double> depths_;          // scaled; depth_columns_ tiles a row
  int depth_columns_ = 0;
};

}  // namespace voxelpipe
