#include "pipeline/batch.h"

#include "gtest/gtest.h"
#include "pipeline/backend.h"
#include "support/meshes.h"
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
  std::vector<BatchItem> items() const {
    std::vector<BatchItem> items;
    for (size_t i = 0; i < meshes.size(); ++i) items.push_back({&meshes[i], &requests[i], &job, {}});
    return items;
  }
};

void ExpectSame(const VoxelizeResult& a, const VoxelizeResult& b) {
  EXPECT_EQ(a.grid.dims, b.grid.dims);
  EXPECT_EQ(a.stats.occupied, b.stats.occupied);
  const auto x = ArraysOf(a), y = ArraysOf(b);
  ASSERT_EQ(x.size(), y.size());
  for (size_t i = 0; i < x.size(); ++i) EXPECT_TRUE(std::ranges::equal(x[i], y[i])) << "array " << i;
}

TEST(VoxelizeBatch, GivesEachItemTheBytesItGetsAlone) {
  const Jobs jobs;
  for (const Backend* device : Devices()) {
    BatchStats stats;
    const auto results = VoxelizeBatch(*device, jobs.items(), 2, {}, &stats);
    ASSERT_EQ(results.size(), jobs.meshes.size());
    EXPECT_GE(stats.passes, 1u);
    for (size_t i = 0; i < results.size(); ++i) {
      ASSERT_TRUE(results[i].ok()) << results[i].status();
      ExpectSame(*results[i], testing::RunPipeline(jobs.meshes[i], jobs.requests[i]));
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
  for (const Backend* device : Devices()) {
    const auto results = VoxelizeBatch(*device, items, 0);
    EXPECT_TRUE(results[0].ok());
    EXPECT_EQ(results[1].status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(results[2].status().code(), absl::StatusCode::kCancelled);
    EXPECT_TRUE(results[3].ok());
  }
}

TEST(VoxelizeBatch, OfNothingIsNothing) {
  EXPECT_TRUE(VoxelizeBatch(*Devices().back(), {}, 1).empty());
}

}  // namespace
}  // namespace voxelpipe
