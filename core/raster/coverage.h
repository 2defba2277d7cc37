// When a triangle covers a voxel.
//
// The first three coverages are one separating-axis test of the triangle against an axis-aligned box around the voxel's
// centre. Coverage and triangle choose the box:
//   conservative  the voxel itself, half sizes (1/2, 1/2, 1/2)
//   thin          the voxel itself, and the plane within max|n_i| / 2 of the centre
//   center        the segment through the centre along the dominant axis: half sizes 1/2 on that axis, 0 on the others
// A degenerate triangle counts as its longest edge and takes the voxel itself under every coverage.
#pragma once

#include "base/vec.h"

namespace voxelpipe {

enum class Coverage : unsigned char {
  kConservative,  // the closed voxel and the closed triangle share a point (26-separating)
  kThin,    // conservative, and the plane passes the centre inside the voxel along the dominant axis (6-separating)
  kCenter,  // the one-voxel segment through the centre along the dominant axis meets the triangle
  kNone,    // no voxel is covered: only a fill sets voxels
};

// max|n_i| at or below this times the square of the longest edge makes a triangle degenerate.
inline constexpr double kDegenerateRatio = 1e-10;

// Every axis test in double is widened by at least this many voxels, so that rounding never loses an exact tie.
inline constexpr double kMinWidening = 1e-6;

// The axis of the largest |n_i|; ties go to x, then y.
template <typename Real>
VOXELPIPE_HD int DominantAxis(const Vec3<Real>& n) {
  const Real x = Abs(n.x), y = Abs(n.y), z = Abs(n.z);
  if (x >= y && x >= z) return 0;
  return y >= z ? 1 : 2;
}

}  // namespace voxelpipe
