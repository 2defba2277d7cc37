#include "grid/grid_spec.h"

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
  EXPECT_EQ(code([](auto& r) { r.padding = -1; }), kInvalidArgument);
  EXPECT_EQ(code([&](auto& r) { r.voxel_size = Vec3d{nan, 1, 1}; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) { r.voxel_size = Vec3d{1, 0, 1}; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) { r.voxel_size = Vec3d{1e-300, 1, 1}; }), kResourceExhausted);
  EXPECT_EQ(code([](auto& r) { r.dims = {1, 1, 1}; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) { r.origin = Vec3d{}; }), kInvalidArgument);
  EXPECT_EQ(code([](auto& r) {
              r.dims = {1, 0, 1};
              r.origin = Vec3d{};
              r.voxel_size = Vec3d{1, 1, 1};
            }),
            kInvalidArgument);
}

}  // namespace
}  // namespace voxelpipe
