// What the look at the triangles says of a mesh, against a count of what it really touches.
#include "pipeline/plan/surface.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "host_mesh/surface_sums.h"
#include "pipeline/stages/backend.h"
#include "pipeline/stages/bind.h"
#include "pipeline/stages/stages.h"
#include "support/meshes/meshes.h"
#include "support/run.h"
#include "unit/pipeline/plan/measured_surface.h"

namespace voxelpipe {
namespace {

using testing::MakeMesh;
using testing::RunPipeline;
using testing::UnitGrid;

Surface Measure(const TriangleMesh& mesh, const VoxelizeRequest& request) {
  return testing::MeasuredSurface(mesh, request, true);
}

VoxelizeRequest BucketRequest(GridRequest grid, Coverage coverage = Coverage::kConservative) {
  VoxelizeRequest request;
  request.grid = std::move(grid);
  request.result = ResultKind::kBuckets;
  request.coverage = coverage;
  request.targets = {testing::FloatTarget(4, Blend::kReplace, {"position", {}})};
  return request;
}

// Measured fragments and voxels within `share` of those of the run.
void ExpectNear(const TriangleMesh& mesh, const VoxelizeRequest& request, double share, const std::string& what) {
  const Surface surface = Measure(mesh, request);
  const VoxelizeResult result = RunPipeline(mesh, request);
  const double fragments = double(result.listed_fragments()), voxels = double(result.listed_voxels());
  EXPECT_NEAR(surface.fragments, fragments, share * fragments) << what;
  EXPECT_GE(surface.voxels, (1 - share) * voxels) << what;
  // Few are not counted, but bounded.
  constexpr double kBytesOfVoxel = 32, kFewBytes = 4 << 20;
  if (surface.voxels * kBytesOfVoxel > kFewBytes) {
    EXPECT_LE(surface.voxels, (1 + share) * voxels) << what;
  }
  EXPECT_GE(surface.rows * 1.01, fragments / 32) << what;
}

TEST(SurfaceTest, APointOnAVoxelCornerIsEightFragments) {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  for (uint32_t i = 0; i < 20000; ++i) {
    for (int k = 0; k < 3; ++k) positions.push_back({5, 9, 7});
    triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  const Surface surface =
      Measure(MakeMesh(std::move(positions), std::move(triangles)), BucketRequest(UnitGrid(20, 20, 20)));
  EXPECT_DOUBLE_EQ(surface.fragments, 160000);
  EXPECT_LE(surface.voxels, 512 * surface.bricks);
}

TEST(SurfaceTest, FacesBetweenVoxelsCountForBothSides) {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  for (uint32_t i = 0; i < 2000; ++i) {
    const Vec3d p{double(1 + i % 37), double(1 + i * 7 % 41), double(1 + i * 11 % 43)};
    const auto v = uint32_t(positions.size());
    for (const Vec3d& d : {Vec3d{0, 0, 0}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0}}) positions.push_back(p + d);
    triangles.push_back({v, v + 1, v + 2});
  }
  const TriangleMesh mesh = MakeMesh(std::move(positions), std::move(triangles));
  ExpectNear(mesh, BucketRequest(UnitGrid(48, 48, 48)), 0.15, "faces on the lattice's planes");
}

TEST(SurfaceTest, SmoothAndRoughMeshesUnderBothCoverages) {
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
    GridRequest grid;
    grid.resolution = 150;
    ExpectNear(testing::Torus(120), BucketRequest(grid, coverage), 0.15, "torus");
    ExpectNear(testing::BumpySphere(40, 3), BucketRequest(grid, coverage), 0.15, "bumpy sphere");
    ExpectNear(testing::Soup(4000, 60, 5), BucketRequest(UnitGrid(60, 60, 60), coverage), 0.25, "soup");
  }
}

TEST(SurfaceTest, ASurfaceThatLiesInItselfCoversItsVoxelsOnce) {
  TriangleMesh mesh = testing::Torus(60);
  const auto once = mesh.triangles;
  for (int i = 0; i < 9; ++i) mesh.triangles.insert(mesh.triangles.end(), once.begin(), once.end());
  mesh.parts[0].triangle_count = mesh.triangles.size();
  GridRequest grid;
  grid.resolution = 200;
  ExpectNear(mesh, BucketRequest(grid), 0.15, "ten in one");
}

TEST(SurfaceTest, TrianglesAreClippedToTheGrid) {
  // Giants, and small ones outside.
  std::vector<Vec3d> positions{{-1e4, -1e4, 10.3}, {1e4, -1e4, 10.3}, {0, 1e4, 10.3}};
  std::vector<std::array<uint32_t, 3>> triangles{{0, 1, 2}};
  for (uint32_t i = 0; i < 3000; ++i) {
    const auto v = uint32_t(positions.size());
    const double x = 100 + double(i);
    for (const Vec3d& d : {Vec3d{0, 0, 0}, Vec3d{3, 0, 1}, Vec3d{0, 3, 2}}) positions.push_back(Vec3d{x, 5, 5} + d);
    triangles.push_back({v, v + 1, v + 2});
  }
  const VoxelizeRequest request = BucketRequest(UnitGrid(64, 64, 64));
  const Surface surface = Measure(MakeMesh(std::move(positions), std::move(triangles)), request);
  EXPECT_NEAR(surface.fragments, 64 * 64, 0.1 * 64 * 64);
}

// Whose boxes meet a few voxels of the grid alone.
TEST(SurfaceTest, GiantsInThinGridsAreClippedToThem) {
  constexpr double kFar = 1e11;
  const std::vector<Vec3d> positions{{-kFar, -kFar, 0.5}, {kFar, -kFar, 0.4}, {0, kFar, 0.6},
                                     {0.5, -kFar, -kFar}, {0.4, kFar, -kFar}, {0.6, 0, kFar}};
  const TriangleMesh mesh = MakeMesh(positions, {{0, 1, 2}, {3, 4, 5}});
  for (const std::array<int64_t, 3>& dims : {std::array<int64_t, 3>{1, 30, 1}, {1, 1, 30}, {30, 1, 1}, {1, 1, 1}}) {
    VoxelizeRequest request;
    request.grid = UnitGrid(dims[0], dims[1], dims[2]);
    request.fill = Fill::kParity;
    const Surface surface = Measure(mesh, request);
    EXPECT_LE(surface.crossings, 2.0 * 30) << dims[0] << "x" << dims[1] << "x" << dims[2];
    EXPECT_LE(surface.fragments, 2.0 * 30);
    EXPECT_TRUE(RunPipeline(mesh, request).stats.fragments.value_or(0) <= 60);
  }
}

TEST(SurfaceTest, LayersThatHaveMostDecideWhatASlabTakes) {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  for (uint32_t i = 0; i < 5000; ++i) {
    const Vec3d p{0.5 + double(i % 60), 0.5 + double(i / 60 % 60), 100.2};
    const auto v = uint32_t(positions.size());
    for (const Vec3d& d : {Vec3d{0, 0, 0}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0}}) positions.push_back(p + d);
    triangles.push_back({v, v + 1, v + 2});
  }
  const VoxelizeRequest request = BucketRequest(UnitGrid(64, 64, 400));
  const GridSpec grid = *FitGrid(request.grid, {});
  const Surface surface = Measure(MakeMesh(std::move(positions), std::move(triangles)), request);
  EXPECT_GT(MostOfSlab(surface, grid, 8).fragments, 0.9 * surface.fragments);
  EXPECT_EQ(MostOfSlab(surface, grid, 400).fragments, surface.fragments);
}

TEST(SurfaceTest, AFillCountsWhatItEncloses) {
  for (const Fill fill : {Fill::kParity, Fill::kFlood}) {
    VoxelizeRequest request;
    request.grid.resolution = 100;
    request.result = ResultKind::kSparse;
    request.fill = fill;
    request.targets = {testing::FloatTarget(4, Blend::kReplace, {"position", {}})};
    const TriangleMesh mesh = testing::Torus(50);
    const Surface surface = Measure(mesh, request);
    const double listed = double(RunPipeline(mesh, request).listed_voxels());
    EXPECT_NEAR(surface.voxels + surface.inside, listed, 0.2 * listed) << Name(fill);
  }
}

// What EstimateSurface says of the sums of a mesh whose grid is given, and so a window.
Surface Estimate(const TriangleMesh& mesh, const VoxelizeRequest& request) {
  MeshView view;
  view.positions = mesh.positions.data();
  view.triangles = reinterpret_cast<const uint32_t(*)[3]>(mesh.triangles.data());
  view.vertex_count = mesh.positions.size();
  view.triangle_count = mesh.triangles.size();
  MeshSize size{mesh.triangles.size(), mesh.positions.size(), {}};
  for (const Vec3d& p : mesh.positions) {
    Box3d& box = size.extent.box;
    for (int a = 0; a < 3; ++a) {
      box.min[a] = box.empty ? p[a] : std::min(box.min[a], p[a]);
      box.max[a] = box.empty ? p[a] : std::max(box.max[a], p[a]);
    }
    box.empty = false;
  }
  size.extent.sums = SumSurface(view, WindowOf(request.grid), {});
  return EstimateSurface(request, *FitGrid(request.grid, size.extent.box), size);
}

TEST(SurfaceSumsTest, APointOnAVoxelCornerIsEightFragments) {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  for (uint32_t i = 0; i < 2000; ++i) {
    for (int k = 0; k < 3; ++k) positions.push_back({5, 9, 7});
    triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  const Surface surface =
      Estimate(MakeMesh(std::move(positions), std::move(triangles)), BucketRequest(UnitGrid(20, 20, 20)));
  EXPECT_DOUBLE_EQ(surface.fragments, 16000);
}

TEST(SurfaceSumsTest, WhatLiesBeyondTheWindowDoesNotCount) {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  const auto add = [&](const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const auto v = uint32_t(positions.size());
    positions.insert(positions.end(), {a, b, c});
    triangles.push_back({v, v + 1, v + 2});
  };
  for (uint32_t i = 0; i < 500; ++i) {
    const double at = 100 + double(i);
    add({at, 3, 3}, {at + 9, 3, 4}, {at, 12, 5});
  }
  const VoxelizeRequest request = BucketRequest(UnitGrid(64, 64, 64));
  const Surface none = Estimate(MakeMesh(positions, triangles), request);
  EXPECT_EQ(none.fragments, 0);
  EXPECT_EQ(none.voxels, 0);
  for (double z = 1.3; z < 63; z += 4) add({-1e4, -1e4, z}, {1e4, -1e4, z + 0.2}, {0, 1e4, z + 0.1});
  const TriangleMesh mesh = MakeMesh(positions, triangles);
  const double fragments = double(RunPipeline(mesh, request).listed_fragments());
  EXPECT_NEAR(Estimate(mesh, request).fragments, fragments, 0.15 * fragments);
}

TEST(SurfaceSumsTest, WholeMeshesAreNearWhatTheyTouch) {
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
    GridRequest grid;
    grid.resolution = 150;
    for (const TriangleMesh& mesh : {testing::Torus(60), testing::BumpySphere(40, 3)}) {
      const VoxelizeRequest request = BucketRequest(grid, coverage);
      const double fragments = double(RunPipeline(mesh, request).listed_fragments());
      EXPECT_NEAR(Estimate(mesh, request).fragments, fragments, 0.2 * fragments) << Name(coverage);
    }
  }
}

// Voxels ten times as flat as wide: the projections that count are those in voxels.
TEST(SurfaceSumsTest, FlatVoxelsCountProjectionsInVoxels) {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  for (uint32_t i = 0; i < 400; ++i) {
    const Vec3d p{double(i % 20) * 2, double(i / 20) * 2, double(i % 20) * 2};  // a slope of 45 degrees
    const auto v = uint32_t(positions.size());
    for (const Vec3d& d : {Vec3d{0, 0, 0}, Vec3d{2, 0, 2}, Vec3d{0, 2, 0}})
      positions.push_back(p + d + Vec3d{.3, .4, .1});
    triangles.push_back({v, v + 1, v + 2});
  }
  const TriangleMesh mesh = MakeMesh(std::move(positions), std::move(triangles));
  for (const Coverage coverage : {Coverage::kThin, Coverage::kConservative}) {
    GridRequest grid;
    grid.dims = {42, 42, 420};
    grid.origin = Vec3d{0, 0, 0};
    grid.voxel_size = Vec3d{1, 1, 0.1};
    const VoxelizeRequest request = BucketRequest(grid, coverage);
    const double fragments = double(RunPipeline(mesh, request).listed_fragments());
    EXPECT_NEAR(Estimate(mesh, request).fragments, fragments, 0.25 * fragments) << Name(coverage);
  }
}

// Squares of such units are no numbers: the mesh's box has to do.
TEST(SurfaceSumsTest, ExtremeUnitsGiveNumbers) {
  for (const double unit : {1e-200, 1e-150, 1e150, 1e200}) {
    TriangleMesh mesh = testing::Torus(30);
    for (Vec3d& p : mesh.positions) p = p * unit;
    GridRequest grid;
    grid.resolution = 64;
    for (const Coverage coverage : {Coverage::kThin, Coverage::kConservative}) {
      const Surface surface = Estimate(mesh, BucketRequest(grid, coverage));
      EXPECT_GE(surface.fragments, double(mesh.triangles.size())) << unit;
      EXPECT_LT(surface.fragments, 64.0 * 64 * 64 * double(mesh.triangles.size())) << unit;
    }
  }
}

}  // namespace
}  // namespace voxelpipe
