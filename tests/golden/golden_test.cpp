// Results that can be counted by hand.
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

TEST(GoldenTest, CubeAtResolution8) {
  VoxelizeRequest request;
  request.grid.resolution = 8;
  EXPECT_EQ(RunPipeline(Cube(2), request).stats.occupied, 296u);  // 8^3 - 6^3
  request.fill = Fill::kParity;
  const VoxelizeResult filled = RunPipeline(Cube(2), request);
  EXPECT_EQ(filled.stats.occupied, 512u);
  EXPECT_EQ(filled.stats.odd_columns, 0u);
  request.grid.padding = 1;
  const VoxelizeResult padded = RunPipeline(Cube(2), request);
  EXPECT_EQ(padded.stats.occupied, 1000u);  // the closed cube touches the layer around it
  EXPECT_EQ(padded.grid.dims, (std::array<int64_t, 3>{10, 10, 10}));
}

TEST(GoldenTest, CubeAtAwkwardResolutions) {
  for (const int64_t n : {1, 3, 7, 49, 50, 107}) {
    VoxelizeRequest request;
    request.grid.resolution = n;
    const VoxelizeResult result = RunPipeline(Cube(0.7), request);
    EXPECT_EQ(result.grid.dims, (std::array<int64_t, 3>{n, n, n}));
    const uint64_t hollow = n > 2 ? uint64_t((n - 2) * (n - 2) * (n - 2)) : 0;
    EXPECT_EQ(result.stats.occupied, uint64_t(n * n * n) - hollow);
  }
}

// A diagonal plane x + y + z = 12 through an 8x8x8 grid, by counting: voxel (i,j,k) is met if i+j+k <= 12 <= i+j+k+3.
TEST(GoldenTest, DiagonalPlane) {
  const TriangleMesh plane = MakeMesh({{40, -14, -14}, {-14, 40, -14}, {-14, -14, 40}}, {{0, 1, 2}});
  uint64_t conservative = 0, thin = 0;
  for (int i = 0; i < 8; ++i) {
    for (int j = 0; j < 8; ++j) {
      for (int k = 0; k < 8; ++k) {
        const int s = i + j + k;
        conservative += s <= 12 && s + 3 >= 12;
        thin += std::abs(s + 1.5 - 12) <= 0.5;  // |n.(c - v0)| <= max|n_i| / 2
      }
    }
  }
  VoxelizeRequest request;
  request.grid = UnitGrid(8, 8, 8);
  EXPECT_EQ(RunPipeline(plane, request).stats.occupied, conservative);
  request.coverage = Coverage::kThin;
  EXPECT_EQ(RunPipeline(plane, request).stats.occupied, thin);
  request.coverage = Coverage::kCenter;
  EXPECT_EQ(RunPipeline(plane, request).stats.occupied, thin);
}

TEST(GoldenTest, PointsAndNothing) {
  VoxelizeRequest request;
  const VoxelizeResult nothing = RunPipeline(MakeMesh({}, {}), request);
  EXPECT_EQ(nothing.grid.dims, (std::array<int64_t, 3>{1, 1, 1}));
  EXPECT_EQ(nothing.stats.occupied, 0u);
  const VoxelizeResult point = RunPipeline(MakeMesh({{3, 4, 5}}, {{0, 0, 0}}), request);
  EXPECT_EQ(point.grid.dims, (std::array<int64_t, 3>{1, 1, 1}));
  EXPECT_EQ(point.grid.origin, (Vec3d{2.5, 3.5, 4.5}));
  EXPECT_EQ(point.stats.occupied, 1u);
}

}  // namespace
}  // namespace voxelpipe
