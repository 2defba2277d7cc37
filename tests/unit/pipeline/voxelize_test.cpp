// Errors, limits, cancellation, plans and counts of the whole run.
#include "pipeline/voxelize.h"

#include <limits>

#include "gmock/gmock.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;
using ::testing::HasSubstr;
using ::testing::Not;

std::string Message(const absl::Status& status) {
  return std::string(status.message());
}

TEST(VoxelizeTest, NamesTheFieldAtFault) {
  const auto error = [](auto change) {
    VoxelizeRequest request;
    change(request);
    const absl::Status s = RunError(Cube(1), request);
    EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument) << s;
    return Message(s);
  };
  EXPECT_THAT(error([](auto& r) { r.targets.clear(); }), HasSubstr("targets:"));
  EXPECT_THAT(error([](auto& r) { r.targets.resize(9); }), HasSubstr("at most 8"));
  EXPECT_THAT(error([](auto& r) {
                r.targets.resize(2);
                r.targets[1].blend = Blend::kMax;
              }),
              HasSubstr("targets[1].blend"));
  EXPECT_THAT(error([](auto& r) { r.targets[0].components = 2; }), HasSubstr("targets[0].components"));
  EXPECT_THAT(error([](auto& r) {
                r.targets[0] = FloatTarget(5, Blend::kMax, {"occupancy", {}});
              }),
              HasSubstr("components"));
  EXPECT_THAT(error([](auto& r) { r.targets[0].shader.name = "nope"; }), HasSubstr("targets[0].shader"));
  EXPECT_THAT(error([](auto& r) { r.targets[0].quantum = 0.3; }), HasSubstr("power of two"));
  EXPECT_THAT(error([](auto& r) { r.targets[0].clear = std::numeric_limits<double>::quiet_NaN(); }),
              HasSubstr("clear"));
  EXPECT_THAT(error([](auto& r) { r.vertex_shader.name = "nope"; }), HasSubstr("vertex_shader"));
  EXPECT_THAT(error([](auto& r) { r.grid.resolution = 0; }), HasSubstr("grid.resolution"));
  EXPECT_THAT(error([](auto& r) { r.threads = -1; }), HasSubstr("threads"));
}

TEST(VoxelizeTest, NoCudaBackendInThisBuild) {
  VoxelizeRequest request;
  request.backend = BackendChoice::kCuda;
  EXPECT_EQ(RunError(Cube(1), request).code(), absl::StatusCode::kFailedPrecondition);
  request.backend = BackendChoice::kCpu;
  EXPECT_EQ(RunPipeline(Cube(1), request).stats.backend, "cpu");
}

TEST(VoxelizeTest, VerticesOutOfReachAreNamed) {
  VoxelizeRequest request;
  request.grid = UnitGrid(4, 4, 4);
  const TriangleMesh far = MakeMesh({{0, 0, 0}, {1, 0, 0}, {0, 2e12, 0}}, {{0, 1, 2}});
  const absl::Status s = RunError(far, request);
  EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(Message(s), HasSubstr("primitive 0, vertex 2"));
  const TriangleMesh bad =
      MakeMesh({{0, 0, 0}, {1, 0, 0}, {0, std::numeric_limits<double>::infinity(), 0}}, {{0, 1, 2}});
  EXPECT_THAT(Message(RunError(bad, request)), HasSubstr("vertex 2: the position is not finite"));
  // A vertex that no triangle uses does not matter.
  TriangleMesh unused = Cube(1);
  unused.positions.push_back({std::numeric_limits<double>::quiet_NaN(), 0, 0});
  EXPECT_EQ(RunPipeline(unused, {}).stats.occupied, RunPipeline(Cube(1), {}).stats.occupied);
}

TEST(VoxelizeTest, GeometryOutsideTheGridIsClipped) {
  VoxelizeRequest request;
  request.grid = UnitGrid(4, 4, 4);
  TriangleMesh away = Cube(2);
  for (Vec3d& p : away.positions) p = p + Vec3d{100, 100, 100};
  EXPECT_EQ(RunPipeline(away, request).stats.occupied, 0u);
}

TEST(VoxelizeTest, RefusesWhatDoesNotFitAndSaysWhatWould) {
  VoxelizeRequest request;
  request.grid.resolution = 1000;
  PlanLimits limits;
  limits.max_result_bytes = 1000;
  const absl::Status s = RunError(Cube(1), request, limits);
  EXPECT_EQ(s.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(Message(s), HasSubstr("needs 119.2 MiB (125000000 bytes) of results;"));
  EXPECT_THAT(Message(s), HasSubstr("the limit of results is 1000 bytes;"));
  EXPECT_THAT(Message(s), HasSubstr("the largest resolution that fits is 20"));  // 20^3 bits are 1000 bytes
  request.grid.resolution = 20;
  EXPECT_TRUE(RunError(Cube(1), request, limits).ok());
  request.grid.resolution = 21;
  EXPECT_FALSE(RunError(Cube(1), request, limits).ok());
  request.grid.dims = {400, 200, 100};
  EXPECT_THAT(Message(RunError(Cube(1), request, limits)), HasSubstr("the largest dims that fit are 40,20,10"));
  request.grid.dims = {40, 20, 10};
  EXPECT_TRUE(RunError(Cube(1), request, limits).ok());
}

TEST(VoxelizeTest, ARefusalForMemorySaysWhichLimitItIsAndWhereItComesFrom) {
  MemoryBudget budget(8 << 20);
  JobContext job;
  job.set_memory(&budget);
  ASSERT_TRUE(budget.Take(1 << 20, "mesh").ok());
  const PlanLimits limits = LimitsInProcess(job);
  EXPECT_EQ(limits.max_result_bytes, PlanLimits().max_result_bytes);
  EXPECT_EQ(limits.max_working_bytes, 7u << 20);
  VoxelizeRequest request;
  request.grid.resolution = 1000;
  const std::string whole = Message(Voxelize(Cube(1), request, {job, limits}).status());
  EXPECT_THAT(whole, HasSubstr(" of memory, where its whole result is held; the limit of memory is 7 MiB (7340032 "
                               "bytes), what the job's budget has left beside the mesh; the largest resolution"));
  request.result = ResultKind::kSparse;
  EXPECT_THAT(Message(Voxelize(Cube(1), request, {job, limits}).status()), Not(HasSubstr("whole result")));
  budget.Give(1 << 20);
  EXPECT_LE(LimitsInProcess(JobContext()).max_working_bytes, PlanLimits().max_working_bytes);
}

TEST(VoxelizeTest, CancelledAndExpiredJobsEnd) {
  JobContext cancelled;
  cancelled.Cancel();
  EXPECT_EQ(Voxelize(Cube(1), {}, {cancelled}).status().code(), absl::StatusCode::kCancelled);
  JobContext expired;
  expired.set_deadline(JobContext::Clock::now() - std::chrono::seconds(1));
  EXPECT_EQ(Voxelize(Cube(1), {}, {expired}).status().code(), absl::StatusCode::kDeadlineExceeded);
}

TEST(VoxelizeTest, CancelInTheMiddleOfAStage) {
  for (const std::string_view stage : {"coarse_raster", "tile_sort", "fine_raster", "fill"}) {
    JobContext* self = nullptr;
    JobContext job([&](std::string_view name, double) {
      if (name == stage) self->Cancel();
    });
    self = &job;
    VoxelizeRequest request;
    request.fill = Fill::kParity;
    request.targets = {FloatTarget(1, Blend::kMax, {"occupancy", {}})};
    EXPECT_EQ(Voxelize(BumpySphere(20, 1), request, {job}).status().code(), absl::StatusCode::kCancelled) << stage;
  }
}

TEST(VoxelizeTest, ThePlanComesFirstAndHolds) {
  const JobContext job;
  VoxelizeRequest request;
  request.grid.resolution = 30;
  request.targets.push_back(FloatTarget(3, Blend::kMax, {"geometric_normal", {}}));
  int plans = 0;
  Plan plan;
  const auto on_plan = [&](const Plan& p) {
    ++plans;
    plan = p;
    return absl::OkStatus();
  };
  const auto result = Voxelize(Cube(1), request, {.job = job, .on_plan = on_plan});
  ASSERT_TRUE(result.ok());
  EXPECT_EQ(plans, 1);
  EXPECT_EQ(plan.grid, result->grid);
  EXPECT_EQ(plan.result_bytes, result->targets[0].size() + result->targets[1].size());
  EXPECT_GE(plan.peak_bytes, plan.result_bytes);
  EXPECT_EQ(plan.backend, "cpu");
}

TEST(VoxelizeTest, StagesAreNamedInOrder) {
  VoxelizeRequest request;
  request.fill = Fill::kParity;
  const auto names_of = [&] {
    std::vector<std::string> names;
    for (const auto& [name, ms] : RunPipeline(Cube(1), request).stats.stages) {
      names.push_back(name);
      EXPECT_GE(ms, 0);
    }
    return names;
  };
  // Row spans of plain bits need no tiles.
  EXPECT_EQ(names_of(), (std::vector<std::string>{"vertex_shade", "plan", "fine_raster", "fill"}));
  request.targets.push_back(FloatTarget(1, Blend::kMax, {"occupancy", {}}));
  EXPECT_EQ(names_of(),
            (std::vector<std::string>{"vertex_shade", "plan", "coarse_raster", "tile_sort", "fine_raster", "fill"}));
}

TEST(VoxelizeTest, OpenMeshesLeaveOddColumns) {
  TriangleMesh open = Cube(1);
  std::erase_if(open.triangles, [&](const auto& t) {  // without the x = 1 face
    return open.positions[t[0]].x == 1 && open.positions[t[1]].x == 1 && open.positions[t[2]].x == 1;
  });
  VoxelizeRequest request;
  request.grid.resolution = 8;
  request.fill = Fill::kParity;
  EXPECT_EQ(RunPipeline(open, request).stats.odd_columns, 64u);
  request.fill = Fill::kNone;
  EXPECT_FALSE(RunPipeline(open, request).stats.odd_columns.has_value());
}

}  // namespace
}  // namespace voxelpipe
