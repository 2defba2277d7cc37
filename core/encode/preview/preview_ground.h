// The ground under the voxels, with their shadow.
#pragma once

#include <vector>

#include "base/vec.h"
#include "encode/preview/preview_canvas.h"
#include "encode/preview/preview_scene.h"

namespace voxelpipe {

// The light on the ground is smooth: it is computed at the nodes of a coarse lattice and interpolated.
class PreviewGround {
 public:
  // Returns early at the end of `job`, which may be null: look at the job before use.
  PreviewGround(const PreviewScene& scene, const PixelRect& rect, const JobContext* job);
  // What the constructor allocates.
  static uint64_t MemoryBytes(const PixelRect& rect);

  // Linear RGB at the centre of a pixel of the rectangle, without the voxels.
  Vec3f At(int px, int py) const {
    const float x = (float(px - rect_.x) + 0.5f) * inverse_step_, y = (float(py - rect_.y) + 0.5f) * inverse_step_;
    const int column = int(x), row = int(y);
    const Vec3f* node = &nodes_[size_t(row) * size_t(columns_) + size_t(column)];
    const Vec3f* below = node + columns_;
    const float u = x - float(column), v = y - float(row);
    const Vec3f top = node[0] + (node[1] - node[0]) * u, bottom = below[0] + (below[1] - below[0]) * u;
    return top + (bottom - top) * v;
  }

 private:
  PixelRect rect_;
  float inverse_step_ = 1;  // pixels^-1
  int columns_ = 0;         // nodes a row
  std::vector<Vec3f> nodes_;
};

}  // namespace voxelpipe
