// A slow reference voxelizer, independent of the product: polygon clipping in long double instead of separating axes.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "base/vec.h"
#include "raster/coverage.h"

namespace voxelpipe::testing {

// True if the closed triangle (index space) touches voxel (x,y,z) under `coverage`, the voxel, slab and segment grown
// by `eps` voxels (shrunk if negative). A degenerate triangle under thin and center is tested as conservative when
// growing and as touching nothing when shrinking, because its definition is a convention of the product.
bool Touches(const Vec3d& a, const Vec3d& b, const Vec3d& c, int64_t x, int64_t y, int64_t z, Coverage coverage,
             double eps);

// Winding number of a closed mesh around p by the sum of solid angles (A. van Oosterom, J. Strackee, 1983), rounded.
int WindingNumber(const std::vector<Vec3d>& positions, const std::vector<std::array<uint32_t, 3>>& triangles,
                  const Vec3d& p);

// Distance of p to a triangle.
double Distance(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c);

}  // namespace voxelpipe::testing
