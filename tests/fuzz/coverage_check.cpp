#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "fuzz/fuzz_checks.h"
#include "support/reference.h"

namespace voxelpipe::fuzz {
namespace {

constexpr double kTolerance = 1e-3;    // voxels: what may be added, and missed by center
constexpr double kNear = 0x1p16;       // voxels: within these extras are bounded
constexpr double kRatioUnsure = 1e-3;  // relative: whether a triangle counts as degenerate is decided in double

double Farthest(const IndexTriangle& t) {
  double most = 1;
  for (const Vec3d& p : t.v) most = std::max({most, std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)});
  return most;
}

// Whether rounding may decide that the triangle is degenerate.
bool MaybeDegenerate(const IndexTriangle& t) {
  using Real = long double;
  Vec3<Real> v[3];
  for (int i = 0; i < 3; ++i) v[i] = {t.v[i].x, t.v[i].y, t.v[i].z};
  const Vec3<Real> n = Cross(v[1] - v[0], v[2] - v[1]);
  const Real largest = std::max({std::fabs(n.x), std::fabs(n.y), std::fabs(n.z)});
  Real longest = 0;
  for (int i = 0; i < 3; ++i) longest = std::max(longest, Dot(v[(i + 1) % 3] - v[i], v[(i + 1) % 3] - v[i]));
  const Real limit = Real(kDegenerateRatio) * longest;
  return std::fabs(largest - limit) <= Real(kRatioUnsure) * limit;
}

}  // namespace

std::string CheckCoverage(const std::vector<IndexTriangle>& triangles, const GridSpec& grid, Coverage coverage,
                          const VoxelFlags& covered) {
  VoxelFlags may(covered.size(), 0);
  bool bounded = true;  // extras
  for (size_t t = 0; t < triangles.size(); ++t) {
    const auto& [v] = triangles[t];
    const double farthest = Farthest(triangles[t]);
    const bool unsure = MaybeDegenerate(triangles[t]);
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
            if (may[n] != 0) continue;
            may[n] = testing::Touches(v[0], v[1], v[2], x, y, z, coverage, kTolerance) ||
                     (unsure && testing::Touches(v[0], v[1], v[2], x, y, z, Coverage::kConservative, kTolerance));
          } else if (!unsure && testing::Touches(v[0], v[1], v[2], x, y, z, coverage, shrink)) {
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
