// Which kernels set occupancy bits, without a device.
#include "cuda/plan/occupancy_plan.h"

#include "gtest/gtest.h"

namespace voxelpipe::cuda {
namespace {

constexpr uint64_t kCache = 50 << 20;

// A cube of n voxels, on a device as an H100.
OccupancyInputs Cube(int64_t n, uint64_t triangles) {
  OccupancyInputs in;
  in.dims = {n, n, n};
  in.bytes = uint64_t(n * n * n / 8);
  in.triangles = triangles;
  in.cache_bytes = kCache;
  in.single_launch_triangles = 4096;
  in.resident_triangles = 500'000;
  in.kernel_clear_bytes = 4 << 20;
  return in;
}

OccupancyPath PathOf(const OccupancyInputs& in) {
  return PlanOccupancy(in).path;
}

TEST(OccupancyPlanTest, AGridWithoutTrianglesIsCleared) {
  EXPECT_EQ(PathOf(Cube(128, 0)), OccupancyPath::kClear);
}

TEST(OccupancyPlanTest, FewTrianglesInAGridBeyondTheCacheGoToBlocks) {
  EXPECT_EQ(PathOf(Cube(1024, 5'000)), OccupancyPath::kBlocks);
  OccupancyInputs in = Cube(1024, 5'000);
  in.without_blocks = true;
  EXPECT_NE(PathOf(in), OccupancyPath::kBlocks);
  in = Cube(1024, 5'000);
  in.alone = false;
  EXPECT_NE(PathOf(in), OccupancyPath::kBlocks);
}

TEST(OccupancyPlanTest, ATinyMeshTakesOneLaunch) {
  EXPECT_EQ(PathOf(Cube(128, 4096)), OccupancyPath::kSingleLaunch);
  EXPECT_NE(PathOf(Cube(128, 4097)), OccupancyPath::kSingleLaunch);
}

TEST(OccupancyPlanTest, TrianglesOfManyRowsShareLanesAndOthersHaveOneWhileAllAreResident) {
  EXPECT_EQ(PlanOccupancy(Cube(256, 20'000)).lanes_per_triangle, 2);  // fewer than voxels of a face
  EXPECT_EQ(PlanOccupancy(Cube(256, 100'000)).lanes_per_triangle, 1);
  EXPECT_EQ(PathOf(Cube(256, 100'000)), OccupancyPath::kResident);
  EXPECT_EQ(PathOf(Cube(256, 500'001)), OccupancyPath::kTriangles);
}

TEST(OccupancyPlanTest, ASmallGridIsClearedByTheKernelThatSetsBits) {
  EXPECT_TRUE(PlanOccupancy(Cube(256, 1'000'000)).clears_in_kernel);
  EXPECT_FALSE(PlanOccupancy(Cube(512, 1'000'000)).clears_in_kernel);
}

TEST(OccupancyPlanTest, LargerTrianglesInAGridFarBeyondTheCacheGoToBricks) {
  OccupancyInputs in = Cube(2048, 1'000'000);
  EXPECT_EQ(PathOf(in), OccupancyPath::kBricks);
  EXPECT_TRUE(PlanOccupancy(in).keeps_together);
  in.without_bricks = true;
  EXPECT_EQ(PathOf(in), OccupancyPath::kTriangles);
  EXPECT_EQ(PathOf(Cube(2048, 10'000'000)), OccupancyPath::kTriangles);  // smaller ones
}

TEST(OccupancyPlanTest, RowsAreSharedIfEnoughTrianglesHaveSeveral) {
  OccupancyInputs in = Cube(512, 1'000'000);
  in.needs_rows = [] { return true; };
  EXPECT_EQ(PathOf(in), OccupancyPath::kRows);
  EXPECT_FALSE(PlanOccupancy(in).rows_together);  // the cache holds the grid
  in.fixed_point = false;
  EXPECT_EQ(PathOf(in), OccupancyPath::kTriangles);
}

TEST(OccupancyPlanTest, AnUnorderedMeshDrawsItsLargestFirstAndKeepsTogetherFarBeyondTheCache) {
  OccupancyInputs in = Cube(512, 2'000'000);
  in.has_ordered_copy = [] { return true; };
  EXPECT_TRUE(PlanOccupancy(in).draws_largest);
  EXPECT_FALSE(PlanOccupancy(in).keeps_together);
  in = Cube(2048, 2'000'000);
  in.has_ordered_copy = [] { return true; };
  EXPECT_TRUE(PlanOccupancy(in).keeps_together);
  EXPECT_EQ(PathOf(in), OccupancyPath::kTriangles);  // no bricks
}

TEST(OccupancyPlanTest, NoGridExceedsAnUnknownCache) {
  OccupancyInputs in = Cube(2048, 5'000);
  in.cache_bytes = 0;
  EXPECT_EQ(PathOf(in), OccupancyPath::kResident);
}

}  // namespace
}  // namespace voxelpipe::cuda
