// Plans: what is refused, and what is said then.
#include "pipeline/plan/plan.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "pipeline/estimate.h"
#include "pipeline/planner.h"
#include "pipeline/stages/backend.h"
#include "pipeline/stages/bind.h"
#include "pipeline/voxelize.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using testing::FloatTarget;
using ::testing::HasSubstr;
using testing::KeepPlan;
using ::testing::Not;
using testing::RunError;
using testing::RunPipeline;

// Hills of n x n squares over [0, 1]^2.
TriangleMesh Terrain(uint32_t n) {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  for (uint32_t j = 0; j <= n; ++j) {
    for (uint32_t i = 0; i <= n; ++i) {
      const double x = double(i) / n, z = double(j) / n;
      positions.push_back({x, 0.01 * std::sin(20 * x) * std::cos(15 * z), z});
    }
  }
  for (uint32_t j = 0; j < n; ++j) {
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t v = i + (n + 1) * j;
      triangles.push_back({v, v + n + 1, v + 1});
      triangles.push_back({v + 1, v + n + 1, v + n + 2});
    }
  }
  return testing::MakeMesh(std::move(positions), std::move(triangles));
}

TEST(PlanTest, ASmallGridInALargeSceneIsPlannedForWhatLiesInIt) {
  VoxelizeRequest request;
  request.result = ResultKind::kBuckets;
  request.grid.dims = {256, 64, 256};
  request.grid.voxel_size = Vec3d{1, 1, 1} * 1e-4;
  request.grid.origin = Vec3d{0.4, -0.0032, 0.4};
  PlanLimits limits;
  limits.max_working_bytes = 128 << 20;
  const JobContext job;
  const auto result = Voxelize(Terrain(150), request, {job, limits});
  ASSERT_TRUE(result.ok()) << result.status();
}

TEST(PlanTest, AMeshOfAnySizeIsPlannedInVoxels) {
  // Areas in square world units would be 0.
  TriangleMesh mesh = testing::Torus(30);
  for (Vec3d& p : mesh.positions) p = p * 1e-200;
  VoxelizeRequest request;
  request.grid.resolution = 16;
  const uint64_t occupied = RunPipeline(mesh, request).stats.occupied;
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    request.result = kind;
    request.targets = {FloatTarget(1, Blend::kMax, {"occupancy", {}})};
    EXPECT_EQ(RunPipeline(mesh, request).stats.occupied, occupied) << Name(kind);
  }
}

TEST(PlanTest, AHintForAResolutionIsAResolution) {
  const TriangleMesh mesh = testing::Torus(40);
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    VoxelizeRequest request;
    request.result = kind;
    request.grid.resolution = 2000;
    request.targets = {FloatTarget(1, Blend::kMax, {"occupancy", {}})};
    PlanLimits limits;
    limits.max_working_bytes = 32 << 20;
    const absl::Status refused = RunError(mesh, request, limits);
    ASSERT_TRUE(LimitErrorOf(refused).has_value()) << refused;
    const LimitError numbers = *LimitErrorOf(refused);
    EXPECT_GT(numbers.need_bytes, numbers.limit_bytes);
    EXPECT_GT(numbers.largest_resolution, 30);
    EXPECT_EQ(numbers.smallest_voxel_size.x, 0);
    EXPECT_THAT(std::string(refused.message()), HasSubstr("largest resolution"));
    request.grid.resolution = numbers.largest_resolution;
    EXPECT_TRUE(RunError(mesh, request, limits).ok()) << Name(kind);
  }
}

TEST(PlanTest, AHintForAVoxelSizeIsAVoxelSize) {
  const TriangleMesh mesh = testing::Torus(40);
  VoxelizeRequest request;
  request.grid.voxel_size = Vec3d{0.001, 0.002, 0.001};
  request.targets = {FloatTarget(1, Blend::kMax, {"occupancy", {}})};
  PlanLimits limits;
  limits.max_working_bytes = 32 << 20;
  const absl::Status refused = RunError(mesh, request, limits);
  ASSERT_TRUE(LimitErrorOf(refused).has_value()) << refused;
  const LimitError numbers = *LimitErrorOf(refused);
  EXPECT_EQ(numbers.largest_resolution, 0);
  EXPECT_GT(numbers.smallest_voxel_size.x, 0.001);
  EXPECT_DOUBLE_EQ(numbers.smallest_voxel_size.y, 2 * numbers.smallest_voxel_size.x);
  EXPECT_THAT(std::string(refused.message()), HasSubstr("smallest voxel size"));
  EXPECT_THAT(std::string(refused.message()), Not(HasSubstr("resolution")));
  request.grid.voxel_size = numbers.smallest_voxel_size;
  EXPECT_TRUE(RunError(mesh, request, limits).ok());
  request.grid.voxel_size = numbers.smallest_voxel_size * 0.97;
  EXPECT_FALSE(RunError(mesh, request, limits).ok());
}

TEST(PlanTest, AHintForAGridThatIsGivenSaysTheSamePlaceInFewerVoxels) {
  const TriangleMesh mesh = testing::Torus(40);
  VoxelizeRequest request;
  request.grid.dims = {2000, 2000, 800};
  request.grid.origin = Vec3d{-1.5, -1.5, -0.5};
  request.grid.voxel_size = Vec3d{3.0 / 2000, 3.0 / 2000, 1.0 / 800};
  request.targets = {FloatTarget(1, Blend::kMax, {"occupancy", {}})};
  PlanLimits limits;
  limits.max_working_bytes = 32 << 20;
  const absl::Status refused = RunError(mesh, request, limits);
  ASSERT_TRUE(LimitErrorOf(refused).has_value()) << refused;
  const std::string text(refused.message());
  const Vec3d size = LimitErrorOf(refused)->smallest_voxel_size;
  ASSERT_GT(size.x, 3.0 / 2000);
  for (int a = 0; a < 3; ++a) {
    const double extent = double((*request.grid.dims)[size_t(a)]) * (*request.grid.voxel_size)[a];
    (*request.grid.dims)[size_t(a)] = int64_t(std::lround(extent / size[a]));
    EXPECT_NEAR(double((*request.grid.dims)[size_t(a)]) * size[a], extent, 1e-9);
  }
  const auto& dims = *request.grid.dims;
  EXPECT_THAT(text, HasSubstr("with dims " + std::to_string(dims[0]) + "," + std::to_string(dims[1]) + "," +
                              std::to_string(dims[2])));
  request.grid.voxel_size = size;
  EXPECT_TRUE(RunError(mesh, request, limits).ok());
}

TEST(PlanTest, WhatCannotBeCountedIsNotPrintedAsANumber) {
  VoxelizeRequest request;
  request.result = ResultKind::kBuckets;
  request.grid.resolution = 1 << 17;
  MeshExtent extent;
  extent.box = {{0, 0, 0}, {1, 1, 1}, false};
  const absl::Status refused = PlanVoxelization(request, UINT64_MAX, 3, extent).status();
  ASSERT_TRUE(LimitErrorOf(refused).has_value()) << refused;
  EXPECT_EQ(LimitErrorOf(refused)->need_bytes, 0u);
  EXPECT_THAT(std::string(refused.message()), Not(HasSubstr("9223372036854775808")));
  EXPECT_THAT(std::string(refused.message()), HasSubstr("more than 2^63"));
  GridRequest tiny;
  tiny.voxel_size = Vec3d{1e-30, 1e-30, 1e-30};
  EXPECT_THAT(std::string(FitGrid(tiny, extent.box).status().message()), HasSubstr("more than 10^15 voxels"));
}

// Measures as the CPU does, and counts how often it looks at all triangles.
class CountingMeasure {
 public:
  CountingMeasure(const TriangleMesh& mesh, const VoxelizeRequest& request) : request_(request) {
    const auto cpu = SelectBackend(BackendChoice::kCpu);
    const auto bound = BindRequest(JobContext(), mesh, request_);
    if (!cpu.ok() || !bound.ok()) return;
    backend_ = *cpu;
    bound_ = *bound;
    auto started = backend_->Start(mesh, *bound_, job_);
    if (!started.ok()) return;
    stages_ = *std::move(started);
    const auto extent = stages_->VertexShade();
    if (extent.ok()) size_ = {mesh.triangles.size(), mesh.positions.size(), *extent};
  }

  absl::Status Plan(const GridRequest& grid, const PlanLimits& limits) {
    request_.grid = grid;
    measured_ = 0;
    const auto measure = [&](const GridSpec& spec, bool closely) {
      measured_ += closely ? 1 : 0;
      return stages_->Measure(spec, size_, closely);
    };
    return PlanOn({*backend_, request_, size_, measure, limits, Delivery::kMemory}).status();
  }
  int measured() const { return measured_; }
  double longest() const {
    const Vec3d extent = size_.extent.box.max - size_.extent.box.min;
    return std::max({extent.x, extent.y, extent.z});
  }

 private:
  const JobContext job_;
  VoxelizeRequest request_;
  const Backend* backend_ = nullptr;
  std::optional<BoundRequest> bound_;
  std::unique_ptr<Stages> stages_;
  MeshSize size_;
  int measured_ = 0;
};

// Each close measurement visits every triangle: a search that made twenty took seconds to say no.
TEST(PlanTest, ARefusalLooksAtTheMeshFourTimes) {
  struct Case {
    const char* name;
    TriangleMesh mesh;
    std::vector<uint64_t> limits;
  };
  constexpr uint64_t kLittle = 24 << 20, kMore = 200 << 20;  // bytes
  const Case meshes[] = {{"torus", testing::Torus(60), {kLittle, kMore}},
                         {"rough", testing::BumpySphere(40, 3), {kLittle}},
                         {"terrain", Terrain(60), {kLittle}},
                         {"cube", testing::Cube(1), {kLittle, kMore}},
                         {"soup", testing::Soup(2000, 10, 1), {kLittle}}};
  for (const Case& c : meshes) {
    for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
      for (const Fill fill : {Fill::kNone, Fill::kParity, Fill::kFlood}) {
        if (kind == ResultKind::kBuckets && fill != Fill::kNone) continue;
        for (const bool sized : {false, true}) {
          for (const uint64_t limit : c.limits) {
            VoxelizeRequest request;
            request.result = kind;
            request.fill = fill;
            request.targets = {FloatTarget(1, Blend::kMax, {"occupancy", {}})};
            CountingMeasure counting(c.mesh, request);
            GridRequest grid;
            grid.resolution = 6000;
            if (sized) grid.voxel_size = Vec3d{1, 1, 1} * (counting.longest() / 6000);
            PlanLimits limits;
            limits.max_working_bytes = limit;
            const std::string what = absl::StrCat(c.name, " ", std::string(Name(kind)), " ", std::string(Name(fill)),
                                                  sized ? " sized " : " ", limit);
            const absl::Status refused = counting.Plan(grid, limits);
            ASSERT_TRUE(LimitErrorOf(refused).has_value()) << what << " " << refused;
            EXPECT_LE(counting.measured(), 4) << what;
            const LimitError numbers = *LimitErrorOf(refused);
            if (sized) {
              grid.voxel_size = numbers.smallest_voxel_size;
            } else {
              grid.resolution = numbers.largest_resolution;
            }
            EXPECT_TRUE(counting.Plan(grid, limits).ok()) << what << " " << refused;
            // Not much less than what fits. Of a soup, a coarser grid may fill more.
            if (c.name == std::string("soup")) continue;
            if (sized) {
              grid.voxel_size = numbers.smallest_voxel_size * 0.9;
            } else {
              grid.resolution = numbers.largest_resolution * 10 / 9 + 1;
            }
            EXPECT_FALSE(counting.Plan(grid, limits).ok()) << what << " " << refused;
          }
        }
      }
    }
  }
}

// A sample that leaves no doubt is enough; near a limit all triangles decide.
TEST(PlanTest, AllTrianglesAreLookedAtWhereASampleComesNearALimit) {
  const TriangleMesh mesh = testing::Torus(150);
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    VoxelizeRequest request;
    request.result = kind;
    request.targets = {FloatTarget(1, Blend::kMax, {"occupancy", {}})};
    if (kind == ResultKind::kBuckets) request.targets[0].blend = Blend::kReplace;
    CountingMeasure counting(mesh, request);
    GridRequest grid;
    grid.resolution = 200;
    PlanLimits limits;
    EXPECT_TRUE(counting.Plan(grid, limits).ok());
    EXPECT_EQ(counting.measured(), 0) << Name(kind);
    limits.max_working_bytes = 1 << 20;
    const absl::Status refused = counting.Plan(grid, limits);
    ASSERT_TRUE(LimitErrorOf(refused).has_value()) << refused;
    limits.max_working_bytes = LimitErrorOf(refused)->need_bytes;
    EXPECT_TRUE(counting.Plan(grid, limits).ok()) << Name(kind);
    EXPECT_EQ(counting.measured(), 1) << Name(kind);
    --limits.max_working_bytes;
    EXPECT_FALSE(counting.Plan(grid, limits).ok()) << Name(kind);
  }
}

// What would fit is looked for among several grids, each of which is measured: the job may end meanwhile.
TEST(PlanTest, AJobThatEndsWhileAHintIsLookedForIsCancelledNotRefused) {
  const auto cpu = SelectBackend(BackendChoice::kCpu);
  ASSERT_TRUE(cpu.ok());
  VoxelizeRequest request;
  request.grid.resolution = 500;
  request.result = ResultKind::kSparse;
  MeshSize mesh{1'000'000, 500'000, {}};
  mesh.extent.box = {{0, 0, 0}, {1, 1, 1}, false};
  PlanLimits limits;
  limits.max_working_bytes = 1 << 20;
  for (const int last : {1, 2}) {
    int measured = 0;
    const auto measure = [&](const GridSpec& grid, bool) -> absl::StatusOr<Surface> {
      if (++measured > last) return absl::CancelledError("the job was cancelled");
      return EstimateSurface(request, grid, mesh);
    };
    EXPECT_TRUE(absl::IsCancelled(PlanOn({**cpu, request, mesh, measure, limits, Delivery::kMemory}).status())) << last;
    EXPECT_EQ(measured, last + 1);
  }
}

// The size of a dense result follows from its grid.
TEST(PlanTest, ADenseResultThatIsTooLargeIsRefusedWithoutALookAtTheMesh) {
  const auto cpu = SelectBackend(BackendChoice::kCpu);
  ASSERT_TRUE(cpu.ok());
  VoxelizeRequest request;
  request.grid.resolution = 4000;
  MeshSize mesh{1'000'000, 500'000, {}};
  mesh.extent.box = {{0, 0, 0}, {1, 1, 1}, false};
  PlanLimits limits;
  limits.max_result_bytes = 1 << 20;
  std::vector<int64_t> dims;
  const auto measure = [&](const GridSpec& grid, bool) -> absl::StatusOr<Surface> {
    dims.push_back(grid.dims[0]);
    return EstimateSurface(request, grid, mesh);
  };
  const absl::Status refused = PlanOn({**cpu, request, mesh, measure, limits, Delivery::kMemory}).status();
  ASSERT_TRUE(LimitErrorOf(refused).has_value()) << refused;
  EXPECT_EQ(LimitErrorOf(refused)->largest_resolution, 203);
  for (const int64_t dim : dims) EXPECT_LE(dim, 203);
}

TEST(PlanTest, AnEstimateIsThePlanOfTheRun) {
  VoxelizeRequest request;
  request.grid.resolution = 120;
  request.targets = {FloatTarget(2, Blend::kMax, {"position", {}})};
  request.vertex_shader = {"transform", {{"matrix", {1, 0, 0, 5, 0, 2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}}};
  const TriangleMesh mesh = testing::BumpySphere(30, 2);
  const JobContext job;
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    request.result = kind;
    Plan told;
    ASSERT_TRUE(Voxelize(mesh, request, {.job = job, .on_plan = KeepPlan(told)}).ok());
    const absl::StatusOr<Plan> estimate = EstimateVoxelization(mesh, request, job, {}, Delivery::kMemory);
    ASSERT_TRUE(estimate.ok()) << estimate.status();
    EXPECT_EQ(estimate->peak_bytes, told.peak_bytes) << Name(kind);
    EXPECT_EQ(estimate->result_bytes, told.result_bytes) << Name(kind);
    EXPECT_EQ(estimate->grid, told.grid) << Name(kind);
  }
}

}  // namespace
}  // namespace voxelpipe
