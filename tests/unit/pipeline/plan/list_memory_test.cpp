// Lists that come to need more than the plan has for them.
#include "pipeline/plan/list_memory.h"

#include <memory>
#include <utility>

#include "base/limit_error.h"
#include "gtest/gtest.h"
#include "pipeline/stages/backend.h"
#include "pipeline/voxelize.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

TEST(ListMemoryTest, TakesFromTheBudgetWhatThePlanHasNot) {
  MemoryBudget budget(1000);
  {
    ListMemory lists(&budget, 300, UINT64_MAX);
    EXPECT_TRUE(lists.Need(300).ok());
    EXPECT_EQ(budget.used_bytes(), 0u);
    EXPECT_TRUE(lists.Need(450).ok());
    EXPECT_TRUE(lists.Need(400).ok());
    EXPECT_EQ(budget.used_bytes(), 150u);
    lists.Hold(200);  // a slab is done; another one begins
    EXPECT_TRUE(lists.Need(250).ok());
    EXPECT_EQ(budget.used_bytes(), 150u);
    EXPECT_TRUE(lists.Need(500).ok());
    EXPECT_EQ(budget.used_bytes(), 400u);
    const absl::Status full = lists.Need(2000);
    ASSERT_TRUE(LimitErrorOf(full).has_value()) << full;
    EXPECT_EQ(LimitErrorOf(full)->limit_bytes, 1000u);
    EXPECT_EQ(lists.refused_bytes(), 0u) << "it was the budget that refused";
  }
  EXPECT_EQ(budget.used_bytes(), 0u);
}

TEST(ListMemoryTest, RefusesWhatIsBeyondThePlansLimits) {
  ListMemory lists(nullptr, 300, 100);
  EXPECT_TRUE(lists.Need(400).ok());
  EXPECT_TRUE(absl::IsResourceExhausted(lists.Need(401)));
  EXPECT_EQ(lists.refused_bytes(), 101u);
}

TEST(ListMemoryTest, ACountStopsWhereItIsRefused) {
  ListMemory lists(nullptr, 3 << 20, 0);
  ListCount count(&lists, 0);
  EXPECT_TRUE(count.Add(1 << 19));
  EXPECT_TRUE(count.Add(1 << 20));
  EXPECT_FALSE(count.Add(4 << 20));
  EXPECT_TRUE(count.stopped());
  EXPECT_TRUE(absl::IsResourceExhausted(count.status()));
  ListCount unbounded(nullptr, 0);
  EXPECT_TRUE(unbounded.Add(uint64_t{1} << 40));
}

// The CPU, whose plans have next to nothing for lists.
class Optimist final : public Backend {
 public:
  std::string_view name() const override { return "optimist"; }
  std::string_view simd() const override { return cpu().simd(); }
  void Run(int threads, const std::function<void()>& body) const override { cpu().Run(threads, body); }
  absl::StatusOr<std::unique_ptr<Stages>> Start(const TriangleMesh& mesh, const BoundRequest& request,
                                                const JobContext& job) const override {
    return cpu().Start(mesh, request, job);
  }
  Footprint Predict(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, const Surface& surface,
                    const PlanLimits& limits, Delivery delivery) const override {
    Footprint all = cpu().Predict(request, grid, mesh, surface, limits, delivery);
    all.peak_bytes = all.peak_bytes - all.list_bytes + 1000;
    all.result_bytes = all.list_bytes = 1000;
    return all;
  }

 private:
  static const Backend& cpu() { return **SelectBackend(BackendChoice::kCpu); }
};

class ListsOfAJob : public ::testing::TestWithParam<ResultKind> {
 protected:
  VoxelizeRequest Request() const {
    VoxelizeRequest request;
    request.grid.resolution = 150;
    request.result = GetParam();
    request.targets = {testing::FloatTarget(4, Blend::kReplace, {"position", {}})};
    return request;
  }
  const TriangleMesh mesh_ = testing::Torus(100);
  const Optimist backend_;
};

TEST_P(ListsOfAJob, AreTakenFromItsBudgetAsTheyAreCounted) {
  MemoryBudget budget(uint64_t{1} << 30);
  JobContext job;
  job.set_memory(&budget);
  Plan plan;
  for (const int64_t slab_depth : {0, 8}) {
    PlanLimits limits;
    limits.slab_depth = slab_depth;
    const auto result = Voxelize(
        mesh_, Request(), {.job = job, .limits = limits, .on_plan = testing::KeepPlan(plan), .backend = &backend_});
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_GE(budget.peak_bytes() + plan.list_bytes, result->bytes());
    EXPECT_EQ(budget.used_bytes(), 0u);
    EXPECT_EQ(plan.backend, "optimist") << "a plan is that of the backend that runs";
  }
}

TEST_P(ListsOfAJob, EndItWhereTheBudgetIsTooSmall) {
  MemoryBudget budget(1 << 20);
  JobContext job;
  job.set_memory(&budget);
  const absl::Status full = Voxelize(mesh_, Request(), {.job = job, .backend = &backend_}).status();
  ASSERT_TRUE(LimitErrorOf(full).has_value()) << full;
  EXPECT_EQ(LimitErrorOf(full)->limit_bytes, 1u << 20);
  EXPECT_EQ(budget.used_bytes(), 0u);
}

TEST_P(ListsOfAJob, EndItBeyondThePlansLimitsWithWhatWouldFit) {
  const JobContext job;
  Plan plan;
  VoxelizeRequest request = Request();
  ASSERT_TRUE(Voxelize(mesh_, request, {.job = job, .on_plan = testing::KeepPlan(plan), .backend = &backend_}).ok());
  PlanLimits limits;
  limits.max_working_bytes = plan.peak_bytes + (2 << 20);
  const absl::Status full = Voxelize(mesh_, request, {.job = job, .limits = limits, .backend = &backend_}).status();
  ASSERT_TRUE(LimitErrorOf(full).has_value()) << full;
  EXPECT_EQ(LimitErrorOf(full)->limit_bytes, limits.max_working_bytes);
  EXPECT_GT(LimitErrorOf(full)->need_bytes, limits.max_working_bytes);
  EXPECT_LT(LimitErrorOf(full)->largest_resolution, 150);
}

// Dense results have no other lists: large triangles touch many tiles.
TEST(PairsOfTrianglesAndTiles, AreTakenFromTheBudgetAsTheyAreCounted) {
  VoxelizeRequest request;
  request.grid.resolution = 300;
  request.targets = {testing::FloatTarget(1, Blend::kMax, {"position", {}})};
  const TriangleMesh mesh = testing::Soup(4000, 10, 1);
  const Optimist backend;
  for (const uint64_t budget_bytes : {uint64_t{1} << 20, uint64_t{1} << 30}) {
    MemoryBudget budget(budget_bytes);
    JobContext job;
    job.set_memory(&budget);
    const auto result = Voxelize(mesh, request, {.job = job, .backend = &backend});
    EXPECT_EQ(absl::IsResourceExhausted(result.status()), budget_bytes == 1 << 20) << result.status();
    EXPECT_EQ(result.ok(), budget_bytes > 1 << 20);
    EXPECT_EQ(budget.used_bytes(), 0u);
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, ListsOfAJob, ::testing::Values(ResultKind::kSparse, ResultKind::kBuckets),
                         [](const auto& test) { return std::string(Name(test.param)); });

}  // namespace
}  // namespace voxelpipe
