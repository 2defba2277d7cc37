#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "fuzz/fuzz_checks.h"
#include "support/reference/reference.h"

namespace voxelpipe::fuzz {
namespace {

constexpr double kTolerance = 1e-3;    // voxels: what may be added, and missed by center
constexpr double kNear = 0x1p16;       // voxels: within these extras are bounded
constexpr double kRatioUnsure = 1e-3;  // relative: the product decides in double if a triangle is degenerate

double Farthest(const IndexTriangle& t) {
  double most = 1;
  for (const Vec3d& p : t.v) most = std::max({most, std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)});
  return most;
}

enum class Shape { kTriangle, kUnsure, kDegenerate };  // unsure: rounding decides

Shape ShapeOf(const IndexTriangle& t) {
  using Real = long double;
  Vec3<Real> v[3];
  for (int i = 0; i < 3; ++i) v[i] = {t.v[i].x, t.v[i].y, t.v[i].z};
  const Vec3<Real> n = Cross(v[1] - v[0], v[2] - v[1]);
  const Real largest = std::max({std::fabs(n.x), std::fabs(n.y), std::fabs(n.z)});
  Real longest = 0;
  for (int i = 0; i < 3; ++i) longest = std::max(longest, Dot(v[(i + 1) % 3] - v[i], v[(i + 1) % 3] - v[i]));
  const Real limit = Real(kDegenerateRatio) * longest;
  if (longest > 0 && std::fabs(largest - limit) <= Real(kRatioUnsure) * limit) return Shape::kUnsure;
  return largest <= limit ? Shape::kDegenerate : Shape::kTriangle;
}

// A degenerate triangle counts as its longest edge; of several that rounding may choose from, as what they share.
bool EdgeTouches(const IndexTriangle& t, int64_t x, int64_t y, int64_t z, double eps) {
  double length[3];
  for (int i = 0; i < 3; ++i) {
    const Vec3d e = t.v[(i + 1) % 3] - t.v[i];
    length[i] = Dot(e, e);
  }
  const double longest = std::max({length[0], length[1], length[2]});
  for (int i = 0; i < 3; ++i) {
    if (length[i] < longest * (1 - 1e-9)) continue;
    const Vec3d &p = t.v[i], &q = t.v[(i + 1) % 3];
    if (!testing::Touches(p, q, q, x, y, z, Coverage::kConservative, eps)) return false;
  }
  return true;
}

bool MustTouch(const IndexTriangle& t, Shape shape, int64_t x, int64_t y, int64_t z, Coverage coverage, double eps) {
  if (shape != Shape::kTriangle && !EdgeTouches(t, x, y, z, eps)) return false;
  return shape == Shape::kDegenerate || testing::Touches(t.v[0], t.v[1], t.v[2], x, y, z, coverage, eps);
}

bool MayTouch(const IndexTriangle& t, Shape shape, int64_t x, int64_t y, int64_t z, Coverage coverage, double eps) {
  if (shape != Shape::kTriangle) coverage = Coverage::kConservative;
  return testing::Touches(t.v[0], t.v[1], t.v[2], x, y, z, coverage, eps);
}

}  // namespace

std::string CheckCoverage(const std::vector<IndexTriangle>& triangles, const GridSpec& grid, Coverage coverage,
                          const VoxelFlags& covered) {
  VoxelFlags may(covered.size(), 0);
  bool bounded = true;  // extras
  for (size_t t = 0; t < triangles.size(); ++t) {
    const auto& [v] = triangles[t];
    const double farthest = Farthest(triangles[t]);
    const Shape shape = ShapeOf(triangles[t]);
    bounded = bounded && farthest <= kNear;
    // The reference's own rounding, and center's tolerance.
    const double shrink = coverage == Coverage::kCenter ? -kTolerance : -(1e-12 + farthest * 0x1p-54);
    int64_t first[3], last[3];
    for (int a = 0; a < 3; ++a) {
      const double lo = std::min({v[0][a], v[1][a], v[2][a]}), hi = std::max({v[0][a], v[1][a], v[2][a]});
      first[a] = int64_t(std::clamp(std::floor(lo - 1.1), 0.0, double(grid.dims[size_t(a)])));
      last[a] = int64_t(std::clamp(std::ceil(hi + 1.1), 0.0, double(grid.dims[size_t(a)])));
    }
    for (int64_t z = first[2]; z < last[2]; ++z) {
      for (int64_t y = first[1]; y < last[1]; ++y) {
        for (int64_t x = first[0]; x < last[0]; ++x) {
          const auto n = size_t(x + grid.dims[0] * (y + grid.dims[1] * z));
          if (covered[n] != 0) {
            may[n] = may[n] != 0 || MayTouch(triangles[t], shape, x, y, z, coverage, kTolerance);
          } else if (MustTouch(triangles[t], shape, x, y, z, coverage, shrink)) {
            return absl::StrCat("coverage: voxel (", x, ",", y, ",", z, ") is missed by triangle ", t, "\n");
          }
        }
      }
    }
  }
  if (!bounded) return "";
  for (size_t n = 0; n < covered.size(); ++n) {
    if (covered[n] != 0 && may[n] == 0) {
      return absl::StrCat("coverage: voxel ", n, " is set, and no triangle is near\n");
    }
  }
  return "";
}

}  // namespace voxelpipe::fuzz
