// What a plan counts for the CUDA backend's lists.
#include "cuda/plan/footprint.h"

#include <cmath>

#include "gtest/gtest.h"
#include "support/run.h"

namespace voxelpipe::cuda {
namespace {

// A sphere-like surface in the unit cube: `triangles` of equal size.
MeshSize Sphere(uint64_t triangles) {
  MeshSize mesh;
  mesh.triangles = triangles;
  mesh.vertices = triangles / 2;
  mesh.extent.box = {{0, 0, 0}, {1, 1, 1}, false};
  const double each = std::sqrt(3.0 / double(triangles));
  SurfaceSums sums;
  sums.triangles = double(triangles);
  sums.area = Vec3d{1, 1, 1} * 1.5;
  sums.dominant = Vec3d{1, 1, 1} * 0.8;
  sums.width = Vec3d{1, 1, 1} * (each * double(triangles));
  mesh.extent.sums = sums;
  return mesh;
}

GridSpec Cube(int64_t n) {
  GridSpec grid;
  grid.dims = {n, n, n};
  grid.voxel_size = Vec3d{1, 1, 1} * (1 / double(n));
  return grid;
}

VoxelizeRequest Floats(Blend blend, ResultKind result) {
  VoxelizeRequest request;
  request.targets = {testing::FloatTarget(1, blend, {"triangle_id", {}})};
  request.result = result;
  return request;
}

// What the device lists.
uint64_t Lists(const VoxelizeRequest& request, int64_t resolution, const MeshSize& mesh) {
  const GridSpec grid = Cube(resolution);
  return uint64_t(DeviceListBytes(request, grid, mesh, EstimateSurface(request, grid, mesh), resolution));
}

TEST(FootprintTest, PlainBitsListNothingButTrianglesThatWaitAndTheirOrder) {
  EXPECT_EQ(Lists(VoxelizeRequest(), 256, Sphere(1'000'000)), 12'000'000u);
}

TEST(FootprintTest, RecordsAndSpansOfBlendedTargetsCount) {
  constexpr uint64_t kTriangles = 1'000'000;
  const uint64_t lists = Lists(Floats(Blend::kMax, ResultKind::kDense), 256, Sphere(kTriangles));
  constexpr uint64_t kRecords = 24 * kTriangles, kSpans = 8 * (kTriangles / 2 + (1 << 18));
  EXPECT_GE(lists, kRecords + kSpans + 4 * kTriangles);
  EXPECT_LT(lists, 2 * (kRecords + kSpans));
  EXPECT_GT(Lists(Floats(Blend::kAdd, ResultKind::kDense), 256, Sphere(kTriangles)), lists);  // sums take 8 bytes
}

TEST(FootprintTest, FilledPartsCountTheirCrossingsAndTheRanksOfVoxels) {
  VoxelizeRequest request;
  request.fill = Fill::kNonzero;
  const GridSpec grid = Cube(256);
  const MeshSize few = Sphere(1000), many = Sphere(100'000);
  const auto bytes = [&](const MeshSize& mesh, double crossings, PartScope scope) {
    request.parts.scope = scope;
    Surface surface = EstimateSurface(request, grid, mesh);
    surface.crossings = crossings;
    return PredictSlabBytes(request, grid, mesh, surface, 256);
  };
  constexpr uint64_t kRanks = 2 << 24;  // of 256^3 voxels
  EXPECT_GE(bytes(few, 0, PartScope::kNode), kRanks);
  // Two keys of 8 bytes each, and what is above the expected number.
  const uint64_t more = bytes(few, 1e8, PartScope::kNode) - bytes(few, 9e7, PartScope::kNode);
  EXPECT_GE(more, uint64_t(1e7) * 16);
  EXPECT_LE(more, uint64_t(1e7) * 24);
  EXPECT_EQ(bytes(few, 1e8, PartScope::kWhole), bytes(few, 0, PartScope::kWhole));
  // Records, although all targets are the coverage.
  request.parts.scope = PartScope::kNode;
  EXPECT_GE(Lists(request, 256, many), 24u * 100'000);
}

TEST(FootprintTest, SlabsHaveNoMoreVoxelsThanSpansHaveNumbersFor) {
  const MeshSize mesh = Sphere(100'000);
  const auto depth = [&](const VoxelizeRequest& request) {
    const GridSpec grid = Cube(2048);
    const Surface surface = EstimateSurface(request, grid, mesh);
    return PredictFootprint(request, grid, mesh, surface, PlanLimits(), Delivery::kMemory).slab_depth;
  };
  EXPECT_EQ(depth(Floats(Blend::kMax, ResultKind::kDense)), 688);  // three of at most 1016 layers, evenly
  EXPECT_LE(depth(Floats(Blend::kMax, ResultKind::kSparse)), 688);
  VoxelizeRequest bits;
  bits.result = ResultKind::kDense;
  EXPECT_EQ(depth(bits), 2048);  // rows need no numbers
}

TEST(FootprintTest, ListsAreMadeInOneSlabWhereMemoryAllows) {
  const MeshSize mesh = Sphere(2'000'000);
  TargetSpec normal = testing::FloatTarget(3, Blend::kReplace, {"normal", {}});
  VoxelizeRequest normals;
  normals.targets = {normal};
  normals.result = ResultKind::kSparse;
  VoxelizeRequest buckets;
  buckets.result = ResultKind::kBuckets;
  for (const VoxelizeRequest& request : {Floats(Blend::kMax, ResultKind::kSparse), normals, buckets}) {
    for (const int64_t n : {896, 960, 992, 1024, 1040, 1600}) {
      const GridSpec grid = Cube(n);
      const Surface surface = EstimateSurface(request, grid, mesh);
      PlanLimits limits;
      const Footprint one = PredictFootprint(request, grid, mesh, surface, limits, Delivery::kMemory);
      EXPECT_GE(one.slab_depth, n);
      EXPECT_LE(one.peak_bytes, limits.max_working_bytes);
      if (one.peak_bytes < 2 * limits.slab_bytes) continue;
      limits.max_working_bytes = one.peak_bytes - 1;
      const Footprint several = PredictFootprint(request, grid, mesh, surface, limits, Delivery::kMemory);
      EXPECT_LT(several.slab_depth, n);
      EXPECT_LE(several.peak_bytes, limits.max_working_bytes);
    }
  }
}

TEST(FootprintTest, SlabsAreCutToTheRoomThatTheDeviceHas) {
  const VoxelizeRequest request = Floats(Blend::kMax, ResultKind::kDense);
  const GridSpec grid = Cube(1024);  // 4 GiB of floats
  const MeshSize mesh = Sphere(100'000);
  const auto depth = [&](uint64_t room) {
    return FittingSlabDepth(request, grid, mesh, EstimateSurface(request, grid, mesh), 1024, room);
  };
  EXPECT_EQ(depth(uint64_t{8} << 30), 1024);
  EXPECT_EQ(depth(uint64_t{4} << 30), 256);  // slabs of a GiB, one of which is copied
  EXPECT_EQ(depth(uint64_t{1} << 30), 64);
  EXPECT_EQ(depth(0), 8);
  uint64_t before = UINT64_MAX;
  for (int64_t layers = 1024; layers >= 8; layers /= 2) {
    const uint64_t bytes = PredictSlabBytes(request, grid, mesh, EstimateSurface(request, grid, mesh), layers);
    EXPECT_LT(bytes, before);
    EXPECT_GE(bytes, uint64_t(layers) * 1024 * 1024 * 4);
    before = bytes;
  }
}

TEST(FootprintTest, SpansOfLargeTrianglesGrowWithTheSurface) {
  const VoxelizeRequest request = Floats(Blend::kMax, ResultKind::kDense);
  const uint64_t less = Lists(request, 512, Sphere(2000)), more = Lists(request, 1024, Sphere(2000));
  EXPECT_GT(more, 3 * less);
  EXPECT_LT(more, 5 * less);
}

TEST(FootprintTest, FragmentsOfBucketsCountTwiceForTheirSort) {
  VoxelizeRequest request;
  request.result = ResultKind::kBuckets;
  const uint64_t less = Lists(request, 256, Sphere(2000)), more = Lists(request, 512, Sphere(2000));
  EXPECT_GT(more, less + less);
  EXPECT_GT(less, 32u * 256 * 256 * 3);  // the surface has so many voxels at least
}

}  // namespace
}  // namespace voxelpipe::cuda
