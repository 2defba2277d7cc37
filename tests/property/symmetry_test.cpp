// What must not change the result: whole-voxel translation, permutation of axes, order of triangles, number of threads.
#include <algorithm>
#include <random>

#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

// Coordinates are multiples of 2^-10, so that translation and permutation are exact.
TriangleMesh DyadicSoup(int triangles, double extent, uint32_t seed) {
  TriangleMesh mesh = Soup(triangles, extent, seed);
  for (Vec3d& p : mesh.positions) {
    for (int a = 0; a < 3; ++a) p[a] = std::floor(p[a] * 1024) / 1024;
  }
  return mesh;
}

class SymmetryTest : public ::testing::TestWithParam<Coverage> {};

TEST_P(SymmetryTest, WholeVoxelTranslation) {
  const TriangleMesh mesh = DyadicSoup(64, 20, 4);
  TriangleMesh moved = mesh;
  for (Vec3d& p : moved.positions) p = p + Vec3d{64, 16, 24};
  VoxelizeRequest request;
  request.coverage = GetParam();
  request.grid = UnitGrid(21, 20, 19);
  const VoxelizeResult here = RunPipeline(mesh, request);
  request.grid.origin = Vec3d{64, 16, 24};
  EXPECT_EQ(Bytes(here.targets[0]), Bytes(RunPipeline(moved, request).targets[0]));
  // And the same voxels elsewhere in a larger grid, in other tiles.
  request.grid = UnitGrid(100, 40, 50);
  const VoxelizeResult there = RunPipeline(moved, request);
  for (int64_t z = 0, n = 0; z < 19; ++z) {
    for (int64_t y = 0; y < 20; ++y) {
      for (int64_t x = 0; x < 21; ++x, ++n) {
        ASSERT_EQ(BitAt(here.targets[0], uint64_t(n)),
                  BitAt(there.targets[0], uint64_t((x + 64) + 100 * ((y + 16) + 40 * (z + 24)))));
      }
    }
  }
}

TEST_P(SymmetryTest, AxisPermutation) {
  // center breaks ties of the dominant axis by axis order, so its triangles must not tie: no lattice ones.
  TriangleMesh mesh = DyadicSoup(64, 20, 6);
  if (GetParam() == Coverage::kCenter) {
    std::erase_if(mesh.triangles, [&](const auto& t) { return t[0] / 3 % 8 == 6; });
  }
  TriangleMesh turned = mesh;
  for (Vec3d& p : turned.positions) p = {p.y, p.z, p.x};
  VoxelizeRequest request;
  request.coverage = GetParam();
  request.grid = UnitGrid(21, 20, 19);
  const VoxelizeResult here = RunPipeline(mesh, request);
  request.grid = UnitGrid(20, 19, 21);
  const VoxelizeResult there = RunPipeline(turned, request);
  EXPECT_EQ(here.stats.occupied, there.stats.occupied);
  for (int64_t z = 0, n = 0; z < 19; ++z) {
    for (int64_t y = 0; y < 20; ++y) {
      for (int64_t x = 0; x < 21; ++x, ++n) {
        ASSERT_EQ(BitAt(here.targets[0], uint64_t(n)), BitAt(there.targets[0], uint64_t(y + 20 * (z + 19 * x))))
            << x << "," << y << "," << z;
      }
    }
  }
}

TEST_P(SymmetryTest, TriangleOrder) {
  TriangleMesh mesh = Soup(200, 30, 8);
  VoxelizeRequest request;
  request.coverage = GetParam();
  request.grid = UnitGrid(33, 31, 29);
  request.targets = {TargetSpec{}, FloatTarget(3, Blend::kMax, {"geometric_normal", {}}),
                     FloatTarget(3, Blend::kMin, {"geometric_normal", {}}),
                     FloatTarget(3, Blend::kAdd, {"geometric_normal", {}})};
  const VoxelizeResult before = RunPipeline(mesh, request);
  std::shuffle(mesh.triangles.begin(), mesh.triangles.end(), std::mt19937(5));
  const VoxelizeResult after = RunPipeline(mesh, request);
  EXPECT_EQ(before.stats.fragments, after.stats.fragments);
  for (size_t t = 0; t < before.targets.size(); ++t) EXPECT_EQ(Bytes(before.targets[t]), Bytes(after.targets[t])) << t;
}

TEST_P(SymmetryTest, ThreadsAndRepetition) {
  const TriangleMesh mesh = BumpySphere(40, 2);
  VoxelizeRequest request;
  request.coverage = GetParam();
  request.fill = Fill::kParity;
  request.grid.resolution = 45;
  request.targets = {TargetSpec{}, FloatTarget(3, Blend::kAdd, {"barycentric", {}}),
                     FloatTarget(1, Blend::kReplace, {"triangle_id", {}})};
  request.threads = 1;
  const VoxelizeResult one = RunPipeline(mesh, request);
  for (const int threads : {1, 2, 4}) {
    request.threads = threads;
    const VoxelizeResult many = RunPipeline(mesh, request);
    for (size_t t = 0; t < one.targets.size(); ++t) EXPECT_EQ(Bytes(one.targets[t]), Bytes(many.targets[t]));
  }
}

INSTANTIATE_TEST_SUITE_P(Coverages, SymmetryTest,
                         ::testing::Values(Coverage::kConservative, Coverage::kThin, Coverage::kCenter),
                         [](const auto& test) { return std::string(Name(test.param)); });

}  // namespace
}  // namespace voxelpipe
