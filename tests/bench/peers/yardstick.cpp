#include "bench/peers/yardstick.h"

#include <cmath>

#include "grid/index_space.h"

namespace voxelpipe::bench {
namespace {

// True if axis n separates the triangle (about the box's centre) from the box of half size 1/2.
bool Separates(const Vec3d& n, const Vec3d (&v)[3]) {
  const double a = Dot(n, v[0]), b = Dot(n, v[1]), c = Dot(n, v[2]);
  const double reach = 0.5 * (std::abs(n.x) + std::abs(n.y) + std::abs(n.z));
  return std::min(a, std::min(b, c)) > reach || std::max(a, std::max(b, c)) < -reach;
}

bool Overlaps(const Vec3d (&triangle)[3], const Vec3d& centre) {
  const Vec3d v[3] = {triangle[0] - centre, triangle[1] - centre, triangle[2] - centre};
  const Vec3d axes[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (const Vec3d& axis : axes) {
    if (Separates(axis, v)) return false;
  }
  const Vec3d edges[3] = {v[1] - v[0], v[2] - v[1], v[0] - v[2]};
  if (Separates(Cross(edges[0], edges[1]), v)) return false;
  for (const Vec3d& edge : edges) {
    for (const Vec3d& axis : axes) {
      if (Separates(Cross(axis, edge), v)) return false;
    }
  }
  return true;
}

}  // namespace

std::vector<uint8_t> PlainLoop(const TriangleMesh& mesh, const GridSpec& grid) {
  std::vector<uint8_t> bits((grid.voxels() + 7) / 8);
  for (const auto& ids : mesh.triangles) {
    Vec3d p[3];
    for (int i = 0; i < 3; ++i) p[i] = WorldToIndex(grid.index_space(), mesh.positions[ids[size_t(i)]]);
    int64_t first[3], last[3];
    for (int a = 0; a < 3; ++a) {
      first[a] = std::max<int64_t>(0, int64_t(std::floor(std::min(p[0][a], std::min(p[1][a], p[2][a])))));
      last[a] = std::min<int64_t>(grid.dims[size_t(a)] - 1,
                                  int64_t(std::floor(std::max(p[0][a], std::max(p[1][a], p[2][a])))));
    }
    for (int64_t z = first[2]; z <= last[2]; ++z) {
      for (int64_t y = first[1]; y <= last[1]; ++y) {
        for (int64_t x = first[0]; x <= last[0]; ++x) {
          if (!Overlaps(p, {double(x) + 0.5, double(y) + 0.5, double(z) + 0.5})) continue;
          const auto n = uint64_t(x + grid.dims[0] * (y + grid.dims[1] * z));
          bits[n / 8] |= uint8_t(1 << (n % 8));
        }
      }
    }
  }
  return bits;
}

}  // namespace voxelpipe::bench
