#include "schedule/cost.h"

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

VoxelizeRequest AtResolution(int64_t n) {
  VoxelizeRequest request;
  request.grid.resolution = n;
  return request;
}

MeshFacts Triangles(uint64_t n) {
  MeshFacts mesh;
  mesh.triangles = n;
  return mesh;
}

TEST(CostTest, GrowsWithEverythingThatMakesWork) {
  const JobCost base = PredictCost(AtResolution(128), Triangles(10'000));
  EXPECT_GT(base.run_ms, 0);
  EXPECT_GT(PredictCost(AtResolution(128), Triangles(1'000'000)).run_ms, 10 * base.run_ms);
  EXPECT_GT(PredictCost(AtResolution(1024), Triangles(10'000)).run_ms, 10 * base.run_ms);

  VoxelizeRequest filled = AtResolution(128);
  filled.fill = Fill::kFlood;
  EXPECT_GT(PredictCost(filled, Triangles(10'000)).run_ms, base.run_ms);
  VoxelizeRequest shaded = AtResolution(128);
  shaded.targets[0].format = VoxelFormat::kF32;
  shaded.targets[0].components = 3;
  EXPECT_GT(PredictCost(shaded, Triangles(10'000)).run_ms, 2 * base.run_ms);
  VoxelizeRequest two = shaded;
  two.targets.push_back(shaded.targets[0]);
  EXPECT_GT(PredictCost(two, Triangles(10'000)).run_ms, PredictCost(shaded, Triangles(10'000)).run_ms);
  VoxelizeRequest buckets = AtResolution(128);
  buckets.result = ResultKind::kBuckets;
  EXPECT_GT(PredictCost(buckets, Triangles(10'000)).run_ms, base.run_ms);
}

TEST(CostTest, BytesAreThoseOfTheResult) {
  EXPECT_EQ(PredictCost(AtResolution(64), Triangles(10)).output_bytes, 64u * 64 * 64 / 8);
  VoxelizeRequest request;
  request.grid.dims = {10, 20, 30};
  request.grid.origin = Vec3d{};
  request.grid.voxel_size = Vec3d{1, 1, 1};
  request.targets[0].format = VoxelFormat::kU16;
  request.targets[0].components = 2;
  const JobCost cost = PredictCost(request, Triangles(10));
  EXPECT_EQ(cost.voxels, 6000u);
  EXPECT_EQ(cost.output_bytes, 24'000u);
  EXPECT_GT(cost.device_bytes, cost.output_bytes);
  request.result = ResultKind::kSparse;
  EXPECT_LT(PredictCost(request, Triangles(1)).output_bytes, 24'000u);
}

TEST(CostTest, AKnownBoxGivesTheGrid) {
  MeshFacts mesh = Triangles(10);
  mesh.box = Box3d{{0, 0, 0}, {4, 2, 1}, false};
  EXPECT_EQ(PredictCost(AtResolution(64), mesh).voxels, 64u * 32 * 16);
}

TEST(CostTest, AFileThatIsToBeLoadedTakesItsTimeAndItsMemory) {
  MeshFacts file;
  file.file_bytes = 10 << 20;
  const JobCost plain = PredictCost(AtResolution(64), file);
  EXPECT_GT(plain.load_ms, 1);
  EXPECT_EQ(plain.held_bytes, 10u << 20);
  EXPECT_GT(plain.triangles, 100'000u);
  file.format = MeshFormat::kDraco;
  EXPECT_GT(PredictCost(AtResolution(64), file).load_ms, 5 * plain.load_ms) << "it must be decoded";
  EXPECT_EQ(PredictCost(AtResolution(64), Triangles(10)).load_ms, 0) << "it is loaded";
}

// All of it is a loader's work: no device worker comes after it.
TEST(CostTest, AnEstimateCostsItsFileAndItsMeasurements) {
  MeshFacts file;
  file.file_bytes = 30 << 20;
  const JobCost load = PredictLoadCost(file), estimate = PredictEstimateCost(AtResolution(64), file);
  EXPECT_EQ(load.load_ms, PredictCost(AtResolution(64), file).load_ms);
  EXPECT_GT(estimate.load_ms, 1.2 * load.load_ms);
  EXPECT_EQ(estimate.run_ms, 0);
  EXPECT_EQ(estimate.held_bytes, 30u << 20);
  EXPECT_EQ(estimate.file_bytes, 30u << 20);

  const auto kept = [](const VoxelizeRequest& request, uint64_t triangles) {
    return PredictEstimateCost(request, Triangles(triangles)).load_ms;
  };
  const double dense = kept(AtResolution(64), 1'000'000);
  EXPECT_GT(dense, 5 * kept(AtResolution(64), 100'000)) << "a stored mesh is measured, too";
  VoxelizeRequest lists = AtResolution(64);
  lists.result = ResultKind::kSparse;
  EXPECT_GT(kept(lists, 1'000'000), 2 * dense) << "of dense results some triangles are looked at";
  VoxelizeRequest filled = lists;
  filled.fill = Fill::kFlood;
  EXPECT_GT(kept(filled, 1'000'000), 1.2 * kept(lists, 1'000'000));
  EXPECT_GT(kept(lists, UINT64_MAX), 1e6);
}

TEST(CostTest, AbsurdRequestsHaveACost) {
  VoxelizeRequest request = AtResolution(int64_t{1} << 62);
  request.result = ResultKind::kBuckets;
  EXPECT_GT(PredictCost(request, Triangles(UINT64_MAX)).run_ms, 1e6);
  EXPECT_GT(PredictCost(AtResolution(-5), Triangles(0)).run_ms, 0);
}

TEST(MeasuredCostTest, LearnsTheRatioOfEachKindAndSize) {
  MeasuredCost measured;
  EXPECT_EQ(measured.Ratio(WorkKind::kCpu, SizeClass::kSmall), 1);
  for (int i = 0; i < 100; ++i) measured.Observe(WorkKind::kCpu, SizeClass::kSmall, 2, 6);
  EXPECT_NEAR(measured.Ratio(WorkKind::kCpu, SizeClass::kSmall), 3, 0.01);
  EXPECT_EQ(measured.Ratio(WorkKind::kCpu, SizeClass::kGiant), 1);
  EXPECT_EQ(measured.Ratio(WorkKind::kCuda, SizeClass::kSmall), 1);
}

TEST(MeasuredCostTest, LearnsNothingFromTasksWithoutAPrediction) {
  MeasuredCost measured;
  for (int i = 0; i < 100; ++i) measured.Observe(WorkKind::kLoad, SizeClass::kSmall, 0, 500);
  EXPECT_EQ(measured.Ratio(WorkKind::kLoad, SizeClass::kSmall), 1);
}

TEST(MeasuredCostTest, AnOutlierMovesLittle) {
  MeasuredCost measured;
  measured.Observe(WorkKind::kCpu, SizeClass::kSmall, 1, 1e9);
  EXPECT_LT(measured.Ratio(WorkKind::kCpu, SizeClass::kSmall), 1.3);
  for (int i = 0; i < 10'000; ++i) measured.Observe(WorkKind::kCuda, SizeClass::kSmall, 1, 1e9);
  EXPECT_EQ(measured.Ratio(WorkKind::kCuda, SizeClass::kSmall), 64);
}

}  // namespace
}  // namespace voxelpipe
