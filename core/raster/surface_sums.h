// Sums over a mesh's triangles, from which the number of voxels that they touch is estimated (pipeline/plan/surface.h).
#pragma once

#include "base/host_device.h"
#include "base/vec.h"

namespace voxelpipe {

// World units. Each triangle is weighted: raster/weighed_triangle.h.
struct SurfaceSums {
  double triangles = 0;
  Vec3d area{};      // projected onto the planes orthogonal to x, y, z
  Vec3d dominant{};  // the same, with only the largest of the three of each triangle
  Vec3d width{};     // extents of each triangle's box
  // Signed volume between the triangles and the centre of the mesh's box: the enclosed volume if the mesh is closed.
  double volume = 0;
};

// The grid, if it is known before the triangles are summed.
struct GridWindow {
  Vec3d origin{}, voxel_size{1, 1, 1};
  Vec3d dims{};  // voxels; 0: the grid is not known

  VOXELPIPE_HD bool known() const { return dims.x > 0; }
  // True if the grid is known and a box, in world space, lies beside it. Touching counts as inside.
  VOXELPIPE_HD bool Misses(const Vec3d& min, const Vec3d& max) const {
    bool misses = false;
    for (int a = 0; a < 3; ++a) {
      misses = misses || max[a] < origin[a] || min[a] > origin[a] + dims[a] * voxel_size[a];
    }
    return known() && misses;
  }
};

}  // namespace voxelpipe
