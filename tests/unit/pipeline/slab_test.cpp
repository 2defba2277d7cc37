// The depth of the slabs changes nothing but the memory.
#include <algorithm>
#include <map>
#include <memory>
#include <utility>

#include "base/device_failure.h"
#include "gtest/gtest.h"
#include "pipeline/stages/backend.h"
#include "support/meshes/meshes.h"
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
    for (const Fill fill : {Fill::kNone, Fill::kParity, Fill::kFlood, Fill::kNonzero}) {
      for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
        const VoxelizeRequest request = TwoTargets(fill, layout, dims);
        const VoxelizeResult whole = RunPipeline(mesh, request);
        for (const int64_t depth : {1, 8, 16, 40}) {
          PlanLimits limits;
          limits.slab_depth = depth;
          const JobContext job;
          auto slabs = Voxelize(mesh, request, {job, limits});
          ASSERT_TRUE(slabs.ok()) << slabs.status();
          EXPECT_EQ(slabs->stats.occupied, whole.stats.occupied);
          EXPECT_EQ(slabs->stats.fragments, whole.stats.fragments);
          EXPECT_EQ(slabs->stats.odd_columns, whole.stats.odd_columns);
          KeepingSink sink;
          auto streamed = VoxelizeTo(mesh, request, {job, limits}, sink);
          ASSERT_TRUE(streamed.ok()) << streamed.status();
          EXPECT_EQ(streamed->occupied, whole.stats.occupied);
          EXPECT_EQ(streamed->fragments, whole.stats.fragments);
          // A target after the other, or a plane, unless one slab is all.
          const int planes = layout == Layout::kPlanar ? 1 + 3 : 2;
          EXPECT_EQ(streamed->passes, depth < dims[2] ? planes : 1) << depth;
          EXPECT_EQ(slabs->stats.passes, 1);
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
  Plan plan;
  auto stats = VoxelizeTo(mesh, request, {job, limits, KeepPlan(plan)}, sink);
  ASSERT_TRUE(stats.ok()) << stats.status();
  EXPECT_LE(sink.largest, limits.slab_bytes);
  EXPECT_LT(plan.peak_bytes, (16 << 20));
  EXPECT_EQ(sink.arrays[0], Bytes(RunPipeline(mesh, request).targets[0]));
}

TEST(Slabs, EndWithTheSinksError) {
  PlanLimits limits;
  limits.slab_depth = 8;
  KeepingSink sink;
  sink.fail_at = 2;
  const JobContext job;
  const auto stats =
      VoxelizeTo(Soup(50, 40, 1), TwoTargets(Fill::kNone, Layout::kPlanar, {40, 40, 40}), {job, limits}, sink);
  EXPECT_EQ(stats.status(), absl::DataLossError("the disk is full"));
  EXPECT_EQ(sink.writes, 2);
}

// The CPU's stages on a device that has room for slabs of so many layers, which is found out when their arrays are
// finished, or, where tiles are sorted by slab, when those are found; arrays arrive later.
class ShortOfMemory final : public Backend {
 public:
  explicit ShortOfMemory(int64_t most_layers, bool by_slab = false) : most_layers_(most_layers), by_slab_(by_slab) {}
  std::string_view name() const override { return "short"; }
  std::string_view simd() const override { return cpu().simd(); }
  Footprint Predict(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, const Surface& surface,
                    const PlanLimits& limits, Delivery delivery) const override {
    return cpu().Predict(request, grid, mesh, surface, limits, delivery);
  }
  void Run(int threads, const std::function<void()>& body) const override { cpu().Run(threads, body); }
  absl::StatusOr<std::unique_ptr<Stages>> Start(const TriangleMesh& mesh, const BoundRequest& request,
                                                const JobContext& job) const override {
    absl::StatusOr<std::unique_ptr<Stages>> stages = cpu().Start(mesh, request, job);
    if (!stages.ok()) return stages.status();
    return std::make_unique<ShortStages>(*std::move(stages), *this);
  }

  mutable int made = 0, failed = 0, waited = 0;  // slabs

 private:
  class ShortStages final : public Stages {
   public:
    ShortStages(std::unique_ptr<Stages> stages, const ShortOfMemory& of) : of_(of), cpu_(std::move(stages)) {}
    absl::StatusOr<MeshExtent> VertexShade() override { return cpu_->VertexShade(); }
    absl::StatusOr<Surface> Measure(const GridSpec& grid, const MeshSize& mesh, bool closely) const override {
      return cpu_->Measure(grid, mesh, closely);
    }
    void Begin(const GridSpec& grid, const Surface& expected, ListMemory* lists) override {
      depth_ = grid.dims[2];
      cpu_->Begin(grid, expected, lists);
    }
    absl::Status SortTriangles(const Slab& slab, StageClock& clock) override {
      GoOn();
      sorted_ = slab;
      if (of_.by_slab_ && slab.depth() > of_.most_layers_) return NoRoom();
      return cpu_->SortTriangles(slab, clock);
    }
    absl::Status FineRaster(const Slab& slab) override {
      BeginSlab(slab);
      return cpu_->FineRaster(slab);
    }
    absl::Status SolidFill() override { return cpu_->SolidFill(); }
    absl::Status EmitFragments(const Slab& slab) override {
      BeginSlab(slab);
      return cpu_->EmitFragments(slab);
    }
    absl::Status SortFragments() override { return cpu_->SortFragments(); }
    absl::Status Resolve() override { return cpu_->Resolve(); }
    SlabCounts Counts(StageClock& clock) const override { return cpu_->Counts(clock); }
    absl::StatusOr<SlabArrays> Finish() override {
      if (layers_ > of_.most_layers_) return NoRoom();
      ++of_.made;
      absl::StatusOr<SlabArrays> arrays = cpu_->Finish();
      if (!arrays.ok() || layers_ == depth_) return arrays;
      EXPECT_LE(of_.made - of_.waited, 2) << "more than one slab is on its way while the next is made";
      return SlabArrays(*std::move(*arrays).Take(), [this] {
        ++of_.waited;
        return absl::OkStatus();
      });
    }
    std::string_view simd() const override { return cpu_->simd(); }

   private:
    absl::Status NoRoom() {
      failed_ = true;
      ++of_.failed;
      return MarkDeviceFailure(absl::ResourceExhaustedError("no room"), DeviceFailureKind::kOutOfMemory);
    }
    // After a failure or not, with the next slab.
    void GoOn() {
      if (std::exchange(failed_, false)) {
        EXPECT_EQ(of_.made, of_.waited) << "arrays of an earlier slab are still to come";
      }
    }
    void BeginSlab(const Slab& slab) {
      EXPECT_FALSE(failed_) << "the triangles of the slab are not sorted";
      EXPECT_EQ(std::exchange(sorted_, Slab()), slab) << "tiles are those of other layers";
      layers_ = slab.depth();
    }

    const ShortOfMemory& of_;
    const std::unique_ptr<Stages> cpu_;
    Slab sorted_;
    int64_t depth_ = 0, layers_ = 0;
    bool failed_ = false;
  };

  static const Backend& cpu() { return **SelectBackend(BackendChoice::kCpu); }

  const int64_t most_layers_;
  const bool by_slab_;
};

TEST(Slabs, GrowThinnerWhereTheDeviceHasNoRoom) {
  const TriangleMesh mesh = Soup(300, 50, 11);
  using Kind = std::pair<ResultKind, bool>;  // and true if tiles are sorted by slab
  for (const auto& [kind, by_slab] :
       {Kind(ResultKind::kDense, false), Kind(ResultKind::kDense, true), Kind(ResultKind::kSparse, false),
        Kind(ResultKind::kSparse, true), Kind(ResultKind::kBuckets, false)}) {
    VoxelizeRequest request =
        TwoTargets(kind == ResultKind::kBuckets ? Fill::kNone : Fill::kParity, Layout::kPlanar, {45, 39, 56});
    request.backend = BackendChoice::kCpu;
    request.result = kind;
    const VoxelizeResult whole = RunPipeline(mesh, request);
    const std::map<int64_t, int> slabs_by_room = {{56, 1}, {55, 2}, {31, 4}, {15, 7}, {8, 7}};
    for (const auto& [room, slabs] : slabs_by_room) {
      const ShortOfMemory device(room, by_slab);
      const auto result = Voxelize(mesh, request, {.job = JobContext(), .backend = &device});
      ASSERT_TRUE(result.ok()) << result.status();
      EXPECT_EQ(device.made, slabs) << room;
      EXPECT_EQ(device.waited, slabs == 1 ? 0 : slabs) << room;
      EXPECT_EQ(result->stats.occupied, whole.stats.occupied);
      EXPECT_EQ(result->stats.fragments, whole.stats.fragments);
      EXPECT_EQ(result->stats.odd_columns, whole.stats.odd_columns);
      const auto expected = ArraysOf(whole), got = ArraysOf(*result);
      ASSERT_EQ(got.size(), expected.size());
      for (size_t i = 0; i < got.size(); ++i) EXPECT_TRUE(std::ranges::equal(got[i], expected[i])) << room << " " << i;
    }
    const ShortOfMemory none(7, by_slab);
    EXPECT_EQ(Voxelize(mesh, request, {.job = JobContext(), .backend = &none}).status().message(), "no room");
    EXPECT_EQ(none.failed, 4) << "56, 32, 16 and 8 layers";
  }
}

TEST(Slabs, OfAStreamGrowThinnerToo) {
  const TriangleMesh mesh = Soup(300, 50, 11);
  VoxelizeRequest request = TwoTargets(Fill::kFlood, Layout::kPlanar, {45, 39, 56});
  request.backend = BackendChoice::kCpu;
  const VoxelizeResult whole = RunPipeline(mesh, request);
  using Room = std::pair<int64_t, bool>;
  for (const auto& [room, by_slab] :
       {Room(56, false), Room(56, true), Room(40, false), Room(40, true), Room(9, false), Room(9, true)}) {
    const ShortOfMemory device(room, by_slab);
    KeepingSink sink;
    const auto stats = VoxelizeTo(mesh, request, {.job = JobContext(), .backend = &device}, sink);
    ASSERT_TRUE(stats.ok()) << stats.status();
    EXPECT_EQ(stats->occupied, whole.stats.occupied);
    ASSERT_EQ(sink.arrays.size(), whole.targets.size());
    for (size_t i = 0; i < sink.arrays.size(); ++i) {
      EXPECT_TRUE(std::ranges::equal(sink.arrays[i], whole.targets[i].bytes())) << room << " " << i;
    }
  }
}

}  // namespace
}  // namespace voxelpipe
