// Flood fill against a plain breadth-first search, voxel by voxel.
#include <algorithm>
#include <deque>

#include "gtest/gtest.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

struct Dims {
  int64_t nx, ny, nz;
};

VoxelizeRequest Request(const Dims& d, Coverage coverage, Fill fill) {
  VoxelizeRequest request;
  request.grid = UnitGrid(d.nx, d.ny, d.nz);
  request.coverage = coverage;
  request.fill = fill;
  return request;
}

std::vector<bool> Occupied(const TriangleMesh& mesh, const Dims& d, Coverage coverage, Fill fill) {
  const VoxelizeResult result = RunPipeline(mesh, Request(d, coverage, fill));
  std::vector<bool> bits(size_t(d.nx * d.ny * d.nz));
  for (size_t n = 0; n < bits.size(); ++n) bits[n] = BitAt(result.targets.at(0), n);
  EXPECT_EQ(result.stats.occupied, uint64_t(std::count(bits.begin(), bits.end(), true)));
  return bits;
}

// The voxels that a search from a layer around the grid reaches through voxels outside `shell`.
std::vector<bool> Reached(const std::vector<bool>& shell, const Dims& d) {
  std::vector<bool> reached(shell.size());
  std::deque<std::array<int64_t, 3>> open;
  const auto visit = [&](int64_t x, int64_t y, int64_t z) {
    if (x < 0 || y < 0 || z < 0 || x >= d.nx || y >= d.ny || z >= d.nz) return;
    const size_t n = size_t(x + d.nx * (y + d.ny * z));
    if (shell[n] || reached[n]) return;
    reached[n] = true;
    open.push_back({x, y, z});
  };
  for (int64_t z = 0; z < d.nz; ++z) {
    for (int64_t y = 0; y < d.ny; ++y) {
      for (int64_t x = 0; x < d.nx; ++x) {
        if (x == 0 || y == 0 || z == 0 || x == d.nx - 1 || y == d.ny - 1 || z == d.nz - 1) visit(x, y, z);
      }
    }
  }
  for (; !open.empty(); open.pop_front()) {
    const auto [x, y, z] = open.front();
    visit(x - 1, y, z), visit(x + 1, y, z), visit(x, y - 1, z), visit(x, y + 1, z), visit(x, y, z - 1),
        visit(x, y, z + 1);
  }
  return reached;
}

// Moves a mesh about the origin into the middle of the grid.
TriangleMesh Placed(TriangleMesh mesh, double scale, const Vec3d& centre) {
  for (Vec3d& p : mesh.positions) p = p * scale + centre;
  return mesh;
}

void ExpectFloodIsTheWalk(const TriangleMesh& mesh, const Dims& d) {
  const std::vector<bool> shell = Occupied(mesh, d, Coverage::kConservative, Fill::kNone);
  const std::vector<bool> reached = Reached(shell, d);
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
    const std::vector<bool> flooded = Occupied(mesh, d, coverage, Fill::kFlood);
    for (size_t n = 0; n < flooded.size(); ++n) {
      ASSERT_EQ(flooded[n], !reached[n]) << "voxel " << n << ", " << Name(coverage);
    }
  }
}

TEST(FloodFill, FillsClosedSurfacesAndKeepsHolesThatReachOut) {
  ExpectFloodIsTheWalk(Placed(Torus(24), 20, {33.3, 30.1, 31.7}), {67, 61, 63});
  ExpectFloodIsTheWalk(Placed(BumpySphere(20, 3), 25, {32, 30, 28}), {65, 60, 57});
}

TEST(FloodFill, FillsNothingBehindASurfaceThatIsOpenToTheGridsSide) {
  TriangleMesh mesh = Placed(BumpySphere(20, 3), 25, {32, 30, 28});
  mesh.triangles.resize(mesh.triangles.size() / 2);
  ExpectFloodIsTheWalk(mesh, {65, 60, 57});
  const std::vector<bool> shell = Occupied(mesh, {65, 60, 57}, Coverage::kConservative, Fill::kNone);
  EXPECT_EQ(Occupied(mesh, {65, 60, 57}, Coverage::kConservative, Fill::kFlood), shell);
}

// A grid inside the mesh sees no outside but its own border.
TEST(FloodFill, FollowsWindingWaysThroughASoup) {
  for (const Dims& d : {Dims{40, 33, 29}, Dims{1, 30, 30}, Dims{64, 1, 40}, Dims{33, 8, 8}}) {
    ExpectFloodIsTheWalk(Soup(60, 40, 7), d);
  }
}

TEST(FloodFill, GivesFilledVoxelsTheirValueAndCoveredOnesTheirs) {
  const TriangleMesh mesh = Placed(Octahedron(1, Rotation({0, 0, 1}, 0.3), {0, 0, 0}), 12, {16, 16, 16});
  VoxelizeRequest request = Request({32, 32, 32}, Coverage::kThin, Fill::kFlood);
  request.targets = {FloatTarget(1, Blend::kMax, {"constant", {{"value", {3}}}})};
  request.targets[0].clear = -1;
  request.targets[0].fill_values = {7};
  const VoxelizeResult result = RunPipeline(mesh, request);
  EXPECT_EQ(FloatAt(result.targets[0], 16 + 32 * (16 + 32 * 16)), 7);
  EXPECT_EQ(FloatAt(result.targets[0], 0), -1);
  const std::vector<bool> thin = Occupied(mesh, {32, 32, 32}, Coverage::kThin, Fill::kNone);
  for (size_t n = 0; n < thin.size(); ++n) {
    if (thin[n]) {
      ASSERT_EQ(FloatAt(result.targets[0], n), 3) << n;
    }
  }
}

}  // namespace
}  // namespace voxelpipe
