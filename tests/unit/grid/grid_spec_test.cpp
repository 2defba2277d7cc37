#include "grid/grid_spec.h"

#include <cmath>
#include <limits>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

Box3d BoxOf(Vec3d min, Vec3d max) {
  return {min, max, false};
}

GridSpec Fit(const GridRequest& request, const Box3d& box) {
  const auto grid = FitGrid(request, box);
  EXPECT_TRUE(grid.ok()) << grid.status();
  return grid.ok() ? *grid : GridSpec{};
}

TEST(GridSpecTest, TightGivesTheLongestAxesExactlyN) {
  for (const int64_t n : {1, 2, 49, 50, 107, 1000}) {
    GridRequest request;
    request.resolution = n;
    const GridSpec grid = Fit(request, BoxOf({-0.1, 0.2, 0.3}, {0.2, 0.5, 0.3}));
    EXPECT_EQ(grid.dims[0], n);
    EXPECT_EQ(grid.dims[2], 1);
    EXPECT_EQ(grid.origin, (Vec3d{-0.1, 0.2, 0.3}));
  }
  GridRequest request;
  request.resolution = 10;
  const GridSpec grid = Fit(request, BoxOf({0, 0, 0}, {10, 5, 2.5}));
  EXPECT_EQ(grid.dims, (std::array<int64_t, 3>{10, 5, 3}));
  EXPECT_EQ(grid.voxel_size, (Vec3d{1, 1, 1}));
}

TEST(GridSpecTest, CubeCentresTheShorterAxes) {
  GridRequest request;
  request.resolution = 4;
  request.fit = GridFit::kCube;
  const GridSpec grid = Fit(request, BoxOf({0, 0, 1}, {8, 4, 1}));
  EXPECT_EQ(grid.dims, (std::array<int64_t, 3>{4, 4, 4}));
  EXPECT_EQ(grid.origin, (Vec3d{0, -2, -3}));
}

TEST(GridSpecTest, VoxelSize) {
  GridRequest request;
  request.voxel_size = Vec3d{0.1, 0.25, 3};
  const GridSpec grid = Fit(request, BoxOf({1, 1, 1}, {1.3, 2.01, 2}));
  EXPECT_EQ(grid.dims, (std::array<int64_t, 3>{3, 5, 1}));  // 0.3/0.1 is 3 but for rounding
  EXPECT_EQ(grid.origin, (Vec3d{1, 1, 1}));
}

// The slack that the definition gives an axis, in voxels.
double SlackByDefinition(double min, double max, double h) {
  return std::max(1e-9, std::min(4e-4, std::ldexp(std::max(std::abs(min), std::abs(max)), -22) / h));
}

TEST(GridSpecTest, TheSlackIsInTheUnitOfFloat32) {
  GridRequest request;
  request.voxel_size = Vec3d{0.1, 0.1, 0.1};
  const double wide = double(0.2f);  // 3e-9 more than two voxels
  EXPECT_EQ(Fit(request, BoxOf({0, 0, 0}, {wide, wide, wide})).dims, (std::array<int64_t, 3>{2, 2, 2}));
  for (const double max : {1.0, 50.0, 3000.0}) {
    const double slack = SlackByDefinition(max - 1, max, 0.1);
    for (const double share : {0.5, 0.99, 1.01}) {
      const double min = max - 1 - share * slack * 0.1;
      EXPECT_EQ(Fit(request, BoxOf({min, min, min}, {max, max, max})).dims[1], share > 1 ? 11 : 10)
          << max << " " << share;
    }
  }
  request.voxel_size.reset();
  request.resolution = 20;
  for (const double share : {0.9, 1.1}) {  // the longest axis is exact, the others have slack
    const double y = 5 + share * SlackByDefinition(0, 5, 0.5) * 0.5;
    EXPECT_EQ(Fit(request, BoxOf({0, 0, 0}, {10, y, 5})).dims, (std::array<int64_t, 3>{20, share > 1 ? 11 : 10, 10}));
  }
}

// Of a box that goes beyond its last voxel by less than the slack: what lies there comes to lie on the far side.
TEST(GridSpecTest, WallsTakeWhatLiesWithinTheSlackBeyondThem) {
  GridRequest request;
  request.voxel_size = Vec3d{0.1, 0.1, 0.1};
  request.padding = 3;
  const double beyond = 1 + 0.8 * SlackByDefinition(0, 1, 0.1) * 0.1;
  const GridSpec grid = Fit(request, BoxOf({0, 0, 0}, {beyond, 0.95, 1}));
  EXPECT_EQ(grid.dims, (std::array<int64_t, 3>{16, 16, 16}));
  const IndexSpace space = grid.index_space();
  EXPECT_EQ(WorldToIndex(space, Vec3d{beyond, 0, 0}).x, 13);
  EXPECT_EQ(WorldToIndex(space, Vec3d{(beyond + 1) / 2, 0, 0}).x, 13);
  EXPECT_LT(WorldToIndex(space, Vec3d{0.9999999, 0, 0}).x, 13);
  EXPECT_GT(WorldToIndex(space, Vec3d{1.1, 0, 0}).x, 13.5) << "what is not within the slack stays";
  EXPECT_EQ(space.wall.y, IndexSpace::kNoWall);
  EXPECT_GT(FarthestToWall(space), 0);
  EXPECT_LE(FarthestToWall(space), 4e-4);

  request.padding = 0;
  request.dims = {10, 10, 10};
  request.origin = Vec3d{0, 0, 0};
  EXPECT_FALSE(Fit(request, BoxOf({0, 0, 0}, {beyond, 0.95, 1})).index_space().has_walls()) << "a given grid has none";
}

TEST(GridSpecTest, Padding) {
  GridRequest request;
  request.resolution = 8;
  request.padding = 2;
  const GridSpec grid = Fit(request, BoxOf({0, 0, 0}, {1, 1, 1}));
  EXPECT_EQ(grid.dims, (std::array<int64_t, 3>{12, 12, 12}));
  EXPECT_EQ(grid.origin, (Vec3d{-0.25, -0.25, -0.25}));
}

TEST(GridSpecTest, ExplicitGridIgnoresTheBox) {
  GridRequest request;
  request.dims = {3, 4, 5};
  request.origin = Vec3d{-1, -2, -3};
  request.voxel_size = Vec3d{0.5, 0.5, 0.5};
  EXPECT_EQ(Fit(request, BoxOf({0, 0, 0}, {100, 100, 100})), Fit(request, Box3d{}));
  EXPECT_EQ(Fit(request, Box3d{}).dims, (std::array<int64_t, 3>{3, 4, 5}));
}

TEST(GridSpecTest, APointAndNothing) {
  const GridSpec point = Fit({}, BoxOf({1, 2, 3}, {1, 2, 3}));
  EXPECT_EQ(point.dims, (std::array<int64_t, 3>{1, 1, 1}));
  EXPECT_EQ(point.origin, (Vec3d{0.5, 1.5, 2.5}));
  EXPECT_EQ(Fit({}, Box3d{}).dims, (std::array<int64_t, 3>{1, 1, 1}));
}

// So that results stack.
TEST(GridSpecTest, CubesAreAsLargeForAPointAndForNothing) {
  GridRequest request;
  request.fit = GridFit::kCube;
  for (const auto& [n, middle] : {std::pair{4, 2.5}, {5, 2.5}, {1, 0.5}}) {
    request.resolution = n;
    for (const Box3d& box : {BoxOf({0, 0, 0}, {1, 2, 3}), BoxOf({1, 2, 3}, {1, 2, 3}), Box3d{}}) {
      EXPECT_EQ(Fit(request, box).dims, (std::array<int64_t, 3>{n, n, n}));
    }
    const GridSpec point = Fit(request, BoxOf({1, 2, 3}, {1, 2, 3}));
    EXPECT_EQ(point.voxel_size, (Vec3d{1, 1, 1}));
    EXPECT_EQ(point.origin, (Vec3d{1 - middle, 2 - middle, 3 - middle}));
    EXPECT_EQ(Fit(request, Box3d{}).origin, (Vec3d{0, 0, 0}));
  }
  request.padding = 2;
  EXPECT_EQ(Fit(request, Box3d{}).dims, (std::array<int64_t, 3>{5, 5, 5}));
  EXPECT_EQ(Fit(request, Box3d{}).origin, (Vec3d{-2, -2, -2}));
}

TEST(GridSpecTest, DimsAloneCentreTheBoxInCubicVoxels) {
  GridRequest request;
  request.dims = {8, 10, 4};
  const GridSpec grid = Fit(request, BoxOf({1, 0, 0}, {3, 2, 2}));  // z fills its 4 voxels
  EXPECT_EQ(grid.dims, (std::array<int64_t, 3>{8, 10, 4}));
  EXPECT_EQ(grid.voxel_size, (Vec3d{0.5, 0.5, 0.5}));
  EXPECT_EQ(grid.origin, (Vec3d{0, -1.5, 0}));
  request.padding = 1;
  EXPECT_EQ(Fit(request, BoxOf({1, 0, 0}, {3, 2, 2})).dims, (std::array<int64_t, 3>{10, 12, 6}));
  EXPECT_EQ(Fit(request, BoxOf({1, 0, 0}, {3, 2, 2})).origin, (Vec3d{-0.5, -2, -0.5}));
  request.padding = 0;
  EXPECT_EQ(Fit(request, BoxOf({1, 2, 3}, {1, 2, 3})).origin, (Vec3d{1 - 4.5, 2 - 5.5, 3 - 2.5})) << "a point";
  EXPECT_EQ(Fit(request, Box3d{}).dims, (std::array<int64_t, 3>{8, 10, 4})) << "no triangles";
  EXPECT_EQ(Fit(request, Box3d{}).origin, (Vec3d{0, 0, 0}));
  // N x N x N is a cube, to the last bit.
  const Box3d odd = BoxOf({-0.1, 0.3, 1e-3}, {0.7, 0.9, 1.7e-2});
  for (const int64_t n : {1, 7, 30, 129}) {
    GridRequest cube;
    cube.resolution = n;
    cube.fit = GridFit::kCube;
    request.dims = {n, n, n};
    EXPECT_EQ(Fit(request, odd), Fit(cube, odd)) << n;
    EXPECT_EQ(Fit(request, odd).voxel_size.x, (odd.max.x - odd.min.x) / double(n)) << n;
  }
}

TEST(GridSpecTest, IndexToWorldMapsVoxelCentres) {
  GridSpec grid;
  grid.origin = {1, 2, 3};
  grid.voxel_size = {2, 4, 8};
  EXPECT_EQ(TransformPoint(grid.index_to_world(), {0, 1, 2}), (Vec3d{2, 8, 23}));
}

TEST(GridSpecTest, RefusesWhatIsNoGrid) {
  const Box3d box = BoxOf({0, 0, 0}, {1, 1, 1});
  const auto code = [&](auto change) {
    GridRequest request;
    change(request);
    return FitGrid(request, box).status().code();
  };
  using enum absl::StatusCode;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(code([](auto& r) { r.resolution = 0; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) { r.resolution = -5; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) { r.resolution = kMaxGridDim + 1; }), kResourceExhausted);
  EXPECT_EQ(code([](auto& r) { r.resolution = kMaxGridDim; }), kResourceExhausted);  // 2^60 voxels
  EXPECT_EQ(code([](auto& r) { r.resolution = 0, r.voxel_size = Vec3d{1, 1, 1}; }), kOk) << "it is not used";
  EXPECT_EQ(code([](auto& r) { r.padding = -1; }), kInvalidArgument);
  EXPECT_EQ(code([&](auto& r) { r.voxel_size = Vec3d{nan, 1, 1}; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) { r.voxel_size = Vec3d{1, 0, 1}; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) { r.voxel_size = Vec3d{1e-300, 1, 1}; }), kResourceExhausted);
  EXPECT_EQ(code([](auto& r) { r.dims = {1, 1, 1}, r.resolution = 0; }), kOk) << "it is not used";
  EXPECT_EQ(code([](auto& r) { r.dims = {1, 0, 1}; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) { r.dims = {1, 1, 1}, r.voxel_size = Vec3d{1, 1, 1}; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) { r.origin = Vec3d{}; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) { r.fit = GridFit::kCube, r.voxel_size = Vec3d{1, 1, 1}; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) { r.fit = GridFit::kCube, r.dims = {1, 1, 1}; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) {
              r.dims = {1, 0, 1};
              r.origin = Vec3d{};
              r.voxel_size = Vec3d{1, 1, 1};
            }),
            kInvalidArgument);
}

}  // namespace
}  // namespace voxelpipe
