// The depth of the slabs changes nothing but the memory.
#include "gtest/gtest.h"
#include "support/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

// Keeps what a sink is given, array by array, and checks the order.
class KeepingSink final : public ResultSink {
 public:
  absl::Status Begin(const ResultHeader& h) override {
    header = h;
    arrays.resize(h.arrays.size());
    return absl::OkStatus();
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    EXPECT_FALSE(bytes.empty());
    EXPECT_GE(array, last_) << "stream order";
    last_ = array;
    largest = std::max(largest, bytes.size());
    arrays.at(array).insert(arrays[array].end(), bytes.begin(), bytes.end());
    return ++writes == fail_at ? absl::DataLossError("the disk is full") : absl::OkStatus();
  }

  ResultHeader header;
  std::vector<std::vector<uint8_t>> arrays;
  size_t largest = 0;
  int writes = 0, fail_at = -1;

 private:
  size_t last_ = 0;
};

VoxelizeRequest TwoTargets(Fill fill, Layout layout, const std::array<int64_t, 3>& dims) {
  VoxelizeRequest request;
  request.grid = UnitGrid(dims[0], dims[1], dims[2]);
  request.fill = fill;
  request.layout = layout;
  request.targets = {TargetSpec{}, FloatTarget(3, Blend::kAdd, {"geometric_normal", {}})};
  return request;
}

TEST(Slabs, GiveTheSameBytesWhateverTheirDepth) {
  const TriangleMesh mesh = Soup(300, 50, 11);
  for (const std::array<int64_t, 3>& dims : {std::array<int64_t, 3>{45, 39, 51}, {32, 8, 64}, {3, 3, 9}}) {
    for (const Fill fill : {Fill::kNone, Fill::kParity, Fill::kFlood}) {
      for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
        const VoxelizeRequest request = TwoTargets(fill, layout, dims);
        const VoxelizeResult whole = RunPipeline(mesh, request);
        for (const int64_t depth : {1, 8, 16, 40}) {
          PlanLimits limits;
          limits.slab_depth = depth;
          const JobContext job;
          auto slabs = Voxelize(mesh, request, job, limits);
          ASSERT_TRUE(slabs.ok()) << slabs.status();
          EXPECT_EQ(slabs->stats.occupied, whole.stats.occupied);
          EXPECT_EQ(slabs->stats.fragments, whole.stats.fragments);
          EXPECT_EQ(slabs->stats.odd_columns, whole.stats.odd_columns);
          KeepingSink sink;
          auto streamed = VoxelizeTo(mesh, request, job, limits, sink);
          ASSERT_TRUE(streamed.ok()) << streamed.status();
          EXPECT_EQ(streamed->occupied, whole.stats.occupied);
          EXPECT_EQ(streamed->fragments, whole.stats.fragments);
          for (size_t t = 0; t < 2; ++t) {
            ASSERT_EQ(Bytes(slabs->targets[t]), Bytes(whole.targets[t])) << depth;
            ASSERT_EQ(sink.arrays[t], Bytes(whole.targets[t])) << depth;
          }
        }
      }
    }
  }
}

TEST(Slabs, AreChosenSoThatAStreamStaysWithinItsMemory) {
  const TriangleMesh mesh = Soup(300, 200, 5);
  VoxelizeRequest request;
  request.grid = UnitGrid(200, 200, 400);
  PlanLimits limits;
  limits.slab_bytes = 1 << 18;
  const JobContext job;
  KeepingSink sink;
  uint64_t predicted = 0;
  auto stats = VoxelizeTo(mesh, request, job, limits, sink, [&](const Plan& plan) { predicted = plan.peak_bytes; });
  ASSERT_TRUE(stats.ok()) << stats.status();
  EXPECT_LE(sink.largest, limits.slab_bytes);
  EXPECT_LT(predicted, (16 << 20));
  EXPECT_EQ(sink.arrays[0], Bytes(RunPipeline(mesh, request).targets[0]));
}

TEST(Slabs, EndWithTheSinksError) {
  PlanLimits limits;
  limits.slab_depth = 8;
  KeepingSink sink;
  sink.fail_at = 2;
  const JobContext job;
  const auto stats =
      VoxelizeTo(Soup(50, 40, 1), TwoTargets(Fill::kNone, Layout::kPlanar, {40, 40, 40}), job, limits, sink);
  EXPECT_EQ(stats.status(), absl::DataLossError("the disk is full"));
  EXPECT_EQ(sink.writes, 2);
}

}  // namespace
}  // namespace voxelpipe
