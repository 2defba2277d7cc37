// From world space to index space, where coverage is decided.
#pragma once

#include "base/vec.h"

namespace voxelpipe {

// In: a grid's origin and voxel size, a point in world units. Out: the point in voxels from the grid's first corner.
VOXELPIPE_HD Vec3d WorldToIndex(const Vec3d& origin, const Vec3d& voxel_size, const Vec3d& p) {
  return {(p.x - origin.x) / voxel_size.x, (p.y - origin.y) / voxel_size.y, (p.z - origin.z) / voxel_size.z};
}

}  // namespace voxelpipe
