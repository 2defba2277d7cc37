#include "pipeline/batch.h"

#include "gtest/gtest.h"
#include "pipeline/stages/backend.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using testing::Bytes;

// Meshes and requests of different size and kind, as clients mix them.
struct Jobs {
  std::vector<TriangleMesh> meshes = {testing::Torus(12), testing::BumpySphere(10, 1), testing::Soup(300, 8, 2),
                                      testing::Cube(3)};
  std::vector<VoxelizeRequest> requests{4};
  JobContext job;

  Jobs() {
    for (size_t i = 0; i < requests.size(); ++i) requests[i].grid.resolution = int64_t(9 + 10 * i);
    for (VoxelizeRequest& request : requests) request.targets.emplace_back();
    requests[1].targets[0] = testing::FloatTarget(3, Blend::kAdd, {"geometric_normal", {}});
    requests[2].result = ResultKind::kSparse;
    requests[3].result = ResultKind::kBuckets;
  }
  std::vector<BatchItem> items() {
    std::vector<BatchItem> items;
    for (size_t i = 0; i < meshes.size(); ++i) {
      items.push_back({&meshes[i], &requests[i], &job, {}, [this, i](absl::StatusOr<VoxelizeResult> result) {
                         ++done[i];
                         results[i] = std::move(result);
                       }});
    }
    return items;
  }
  // What the last batch gave.
  std::vector<absl::StatusOr<VoxelizeResult>> results = std::vector<absl::StatusOr<VoxelizeResult>>(4);
  std::vector<int> done = std::vector<int>(4);
};

void ExpectSame(const VoxelizeResult& a, const VoxelizeResult& b) {
  EXPECT_EQ(a.grid.dims, b.grid.dims);
  EXPECT_EQ(a.stats.occupied, b.stats.occupied);
  const auto x = ArraysOf(a), y = ArraysOf(b);
  ASSERT_EQ(x.size(), y.size());
  for (size_t i = 0; i < x.size(); ++i) EXPECT_TRUE(std::ranges::equal(x[i], y[i])) << "array " << i;
}

TEST(VoxelizeBatch, GivesEachItemTheBytesItGetsAlone) {
  for (const Backend* device : Devices()) {
    Jobs jobs;
    const BatchStats stats = VoxelizeBatch(*device, jobs.items(), 2);
    EXPECT_GE(stats.passes, 1u);
    for (size_t i = 0; i < jobs.meshes.size(); ++i) {
      EXPECT_EQ(jobs.done[i], 1);
      ASSERT_TRUE(jobs.results[i].ok()) << jobs.results[i].status();
      ExpectSame(*jobs.results[i], testing::RunPipeline(jobs.meshes[i], jobs.requests[i]));
    }
  }
}

TEST(VoxelizeBatch, KeepsAnErrorToItsItem) {
  Jobs jobs;
  jobs.requests[1].targets[0].shader.name = "no_such_shader";
  JobContext cancelled;
  cancelled.Cancel();
  std::vector<BatchItem> items = jobs.items();
  items[2].job = &cancelled;
  items[3].on_plan = [](const Plan&) { return absl::ResourceExhaustedError("not now"); };
  for (const Backend* device : Devices()) {
    VoxelizeBatch(*device, items, 0);
    EXPECT_TRUE(jobs.results[0].ok());
    EXPECT_EQ(jobs.results[1].status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(jobs.results[2].status().code(), absl::StatusCode::kCancelled);
    EXPECT_EQ(jobs.results[3].status().code(), absl::StatusCode::kResourceExhausted);
  }
}

// The CPU, whose shared pass plans all items and then leaves them to run alone.
class GivesUp final : public Backend {
 public:
  std::string_view name() const override { return "gives up"; }
  std::string_view simd() const override { return cpu().simd(); }
  void Run(int threads, const std::function<void()>& body) const override { cpu().Run(threads, body); }
  Footprint Predict(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, const Surface& surface,
                    const PlanLimits& limits, Delivery delivery) const override {
    return cpu().Predict(request, grid, mesh, surface, limits, delivery);
  }
  absl::StatusOr<std::unique_ptr<Stages>> Start(const TriangleMesh& mesh, const BoundRequest& request,
                                                const JobContext& job) const override {
    return cpu().Start(mesh, request, job);
  }
  std::vector<size_t> RunShared(int, std::span<const BatchItem> items, const PlanLimits&, BatchStats&) const override {
    std::vector<size_t> alone;
    for (size_t i = 0; i < items.size(); ++i) {
      if (i % 2 == 0 && items[i].on_plan) {
        EXPECT_TRUE(items[i].on_plan(Plan()).ok());
      }
      alone.push_back(i);
    }
    return alone;
  }

 private:
  static const Backend& cpu() { return **SelectBackend(BackendChoice::kCpu); }
};

TEST(VoxelizeBatch, TellsAPlanOnceWhereASharedPassGivesUp) {
  Jobs jobs;
  std::vector<BatchItem> items = jobs.items();
  std::vector<int> told(items.size());
  for (size_t i = 0; i < items.size(); ++i) {
    items[i].on_plan = [&count = told[i]](const Plan&) {
      ++count;
      return absl::OkStatus();
    };
  }
  const BatchStats stats = VoxelizeBatch(GivesUp(), items, 1);
  EXPECT_EQ(stats.passes, 4u);
  EXPECT_EQ(told, std::vector<int>(4, 1));
  EXPECT_EQ(jobs.done, std::vector<int>(4, 1));
  for (const auto& result : jobs.results) EXPECT_TRUE(result.ok()) << result.status();
}

TEST(VoxelizeBatch, OfNothingTakesNoPass) {
  EXPECT_EQ(VoxelizeBatch(*Devices().back(), {}, 1).passes, 0u);
}

}  // namespace
}  // namespace voxelpipe
