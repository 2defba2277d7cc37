// Thin is within conservative; the shell of a closed mesh separates inside from outside: 26-neighbours cannot pass the
// conservative shell, 6-neighbours cannot pass the thin one.
#include <deque>

#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

// Floods from the grid's corner through clear voxels and returns true if `goal` is reached.
bool Leaks(const VoxelizeResult& result, const std::array<int64_t, 3>& goal, bool diagonal_moves) {
  const auto& d = result.grid.dims;
  const auto at = [&](int64_t x, int64_t y, int64_t z) { return uint64_t(x + d[0] * (y + d[1] * z)); };
  std::vector<bool> seen(result.grid.voxels());
  std::deque<std::array<int64_t, 3>> queue{{0, 0, 0}};
  EXPECT_FALSE(BitAt(result.targets[0], 0));
  EXPECT_FALSE(BitAt(result.targets[0], at(goal[0], goal[1], goal[2])));
  seen[0] = true;
  while (!queue.empty()) {
    const auto v = queue.front();
    queue.pop_front();
    if (v == goal) return true;
    for (int dz = -1; dz <= 1; ++dz) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          const int moved = std::abs(dx) + std::abs(dy) + std::abs(dz);
          if (moved == 0 || (moved > 1 && !diagonal_moves)) continue;
          const int64_t x = v[0] + dx, y = v[1] + dy, z = v[2] + dz;
          if (x < 0 || y < 0 || z < 0 || x >= d[0] || y >= d[1] || z >= d[2]) continue;
          const uint64_t n = at(x, y, z);
          if (seen[n] || BitAt(result.targets[0], n)) continue;
          seen[n] = true;
          queue.push_back({x, y, z});
        }
      }
    }
  }
  return false;
}

VoxelizeRequest RequestFor(Coverage coverage, int64_t resolution) {
  VoxelizeRequest request;
  request.coverage = coverage;
  request.grid.resolution = resolution;
  request.grid.fit = GridFit::kCube;
  request.grid.padding = 2;
  return request;
}

void ExpectTight(const TriangleMesh& mesh, int64_t resolution) {
  const VoxelizeResult conservative = RunPipeline(mesh, RequestFor(Coverage::kConservative, resolution));
  const VoxelizeResult thin = RunPipeline(mesh, RequestFor(Coverage::kThin, resolution));
  const VoxelizeResult center = RunPipeline(mesh, RequestFor(Coverage::kCenter, resolution));
  for (uint64_t n = 0; n < thin.grid.voxels(); ++n) {
    ASSERT_TRUE(!BitAt(thin.targets[0], n) || BitAt(conservative.targets[0], n));
    ASSERT_TRUE(!BitAt(center.targets[0], n) || BitAt(conservative.targets[0], n));
  }
  EXPECT_LT(thin.stats.occupied, conservative.stats.occupied);
  const int64_t middle = resolution / 2 + 2;
  EXPECT_FALSE(Leaks(conservative, {middle, middle, middle}, true));
  EXPECT_FALSE(Leaks(thin, {middle, middle, middle}, false));
}

TEST(SeparationTest, TiltedOctahedra) {
  const double angles[] = {0, 0.1, 0.5235987755982988, 0.7853981633974483, 1.0};
  const Vec3d axes[] = {{0, 0, 1}, {0.6, 0.8, 0}, {0.5773502691896258, 0.5773502691896258, 0.5773502691896258}};
  for (const double angle : angles) {
    for (const Vec3d& axis : axes) ExpectTight(Octahedron(1, Rotation(axis, angle), {0, 0, 0}), 24);
  }
}

// Faces pass exactly through voxel corners and centres.
TEST(SeparationTest, OctahedraOnTies) {
  for (const double shift : {0.0, 0.25, 0.5}) {
    VoxelizeRequest request;
    request.grid = UnitGrid(24, 24, 24);
    request.coverage = Coverage::kThin;
    const Vec3d centre{12 + shift, 12 + shift, 12 + shift};
    for (const double r : {6.0, 6.5, 7.0, 7.25}) {
      const TriangleMesh mesh = Octahedron(r, Mat4d{}, centre);
      EXPECT_FALSE(Leaks(RunPipeline(mesh, request), {12, 12, 12}, false)) << shift << " " << r;
      request.coverage = Coverage::kConservative;
      EXPECT_FALSE(Leaks(RunPipeline(mesh, request), {12, 12, 12}, true)) << shift << " " << r;
      request.coverage = Coverage::kThin;
    }
  }
}

TEST(SeparationTest, ManySmallTriangles) {
  ExpectTight(BumpySphere(24, 9), 20);
  ExpectTight(BumpySphere(8, 10), 48);
}

}  // namespace
}  // namespace voxelpipe
