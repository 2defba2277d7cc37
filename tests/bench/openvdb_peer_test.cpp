// The peer must do the work it is measured for: mark the surface that we mark, on the same grid.
#include "bench/peers/openvdb_peer.h"

#include "bench/meshes.h"
#include "gtest/gtest.h"
#include "pipeline/voxelize.h"

namespace voxelpipe::bench {
namespace {

TEST(OpenVdb, MarksEveryCentreWithinAVoxelOfTheSurface) {
  // A square of 20 x 20 voxels, a quarter of a voxel above the centres of one layer and three quarters below the next.
  TriangleMesh square;
  square.positions = {{2, 2, 5.75}, {22, 2, 5.75}, {22, 22, 5.75}, {2, 22, 5.75}};
  square.triangles = {{0, 1, 2}, {0, 2, 3}};
  GridSpec grid;
  grid.dims = {24, 24, 12};
  grid.origin = {0, 0, 0};
  grid.voxel_size = {1, 1, 1};
  const std::optional<PeerRun> run = RunOpenVdb(square, grid, 1);
  ASSERT_TRUE(run.has_value());
  // Two layers; around the square may stand a rim of centres half a voxel away.
  EXPECT_GE(run->voxels, 2u * 20 * 20);
  EXPECT_LE(run->voxels, 2u * 22 * 22);
}

TEST(OpenVdb, MarksAboutAsManyVoxelsAsTheConservativeCoverage) {
  VoxelizeRequest request;
  request.grid.resolution = 64;
  const TriangleMesh mesh = BumpySphere(2'000);
  const auto ours = Voxelize(mesh, request, {JobContext()});
  ASSERT_TRUE(ours.ok());
  const std::optional<PeerRun> run = RunOpenVdb(mesh, ours->grid, 1);
  ASSERT_TRUE(run.has_value());
  EXPECT_GT(double(run->voxels), 0.9 * double(ours->stats.occupied));
  EXPECT_LT(double(run->voxels), 1.6 * double(ours->stats.occupied));
}

}  // namespace
}  // namespace voxelpipe::bench
