// What is summed over a mesh's triangles to estimate what they touch of a grid (pipeline/plan/surface.h).
#pragma once

#include "base/host_device.h"
#include "base/vec.h"

namespace voxelpipe {

// World units. Triangles count with a weight: see raster/weighed_triangle.h.
struct SurfaceSums {
  double triangles = 0;
  Vec3d area{};      // projected onto the planes orthogonal to x, y, z
  Vec3d dominant{};  // the same, of each triangle only the largest of the three
  Vec3d width{};     // extents of each triangle's box
  // Signed, between the triangles and the centre of the mesh's box: the enclosed one where the mesh is closed.
  double volume = 0;
};

// The grid, where it is known before a triangle is looked at.
struct GridWindow {
  Vec3d origin{}, voxel_size{1, 1, 1};
  Vec3d dims{};  // voxels; 0 where the grid is not known

  VOXELPIPE_HD bool known() const { return dims.x > 0; }
};

}  // namespace voxelpipe
