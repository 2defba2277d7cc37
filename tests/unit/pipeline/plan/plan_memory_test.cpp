// The predicted peak of a run against what the run's pages take, for all kinds of results. Each case is a process of
// its own under ctest.
#include <malloc.h>

#include <cstdlib>
#include <fstream>
#include <string>

#include "gtest/gtest.h"
#include "support/meshes/meshes.h"
#include "support/run.h"
#include "support/sanitized.h"

namespace voxelpipe {
namespace {

using testing::FloatTarget;

// A line of /proc/self/status in bytes.
uint64_t StatusBytes(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind(key + ":", 0) == 0) return std::strtoull(line.c_str() + key.size() + 1, nullptr, 10) * 1024;
  }
  return 0;
}

// Resets VmHWM to the current resident memory; false if the system does not allow it.
bool ResetPeak() {
  std::ofstream refs("/proc/self/clear_refs");
  refs << 5;
  refs.flush();
  return refs.good() && StatusBytes("VmHWM") < StatusBytes("VmRSS") + (1 << 20);
}

class Swallow final : public ResultSink {
 public:
  absl::Status Begin(const ResultHeader&) override { return absl::OkStatus(); }
  absl::Status Write(size_t, std::span<const uint8_t> bytes) override {
    bytes_ += bytes.size();
    return absl::OkStatus();
  }
  uint64_t bytes() const { return bytes_; }

 private:
  uint64_t bytes_ = 0;
};

struct Case {
  std::string name;
  bool fine;  // a smooth mesh of a million triangles, otherwise a rough one of 14 thousand
  int64_t resolution;
  std::vector<TargetSpec> targets = VoxelizeRequest().targets;
  ResultKind result = ResultKind::kDense;
  Fill fill = Fill::kNone;
  bool streamed = false;
  Coverage coverage = Coverage::kConservative;
  std::string vertex_shader = "identity";
  int64_t slab_depth = 0;  // 0: the plan's choice
};

void PrintTo(const Case& c, std::ostream* out) {
  *out << c.name;
}

std::vector<Case> Cases() {
  const TargetSpec f32 = FloatTarget(1, Blend::kMax, {"occupancy", {}});
  const TargetSpec normal = FloatTarget(4, Blend::kAdd, {"normal", {}});
  const TargetSpec position = FloatTarget(3, Blend::kMax, {"position", {}});
  TargetSpec id = f32;
  id.format = VoxelFormat::kU32;
  id.shader = {"triangle_id", {}};
  TargetSpec checker;
  checker.shader = {"checker", {}};
  const std::vector<TargetSpec> bits = VoxelizeRequest().targets;
  const auto dense = ResultKind::kDense, sparse = ResultKind::kSparse, buckets = ResultKind::kBuckets;
  return {
      {"bits", false, 900},
      {"bits_streamed", false, 1536, bits, dense, Fill::kNone, true},
      {"bits_in_whole_words", false, 896},
      {"bits_of_a_fine_mesh", true, 700},
      {"bits_moved", true, 640, bits, dense, Fill::kNone, false, Coverage::kThin, "transform"},
      {"bits_parity", false, 900, bits, dense, Fill::kParity},
      {"bits_nonzero", false, 900, bits, dense, Fill::kNonzero},
      {"bits_flood", false, 900, bits, dense, Fill::kFlood},
      {"shaded_bits", false, 900, {checker}},
      {"f32", false, 320, {f32}},
      {"f32_of_a_fine_mesh", true, 256, {f32}},
      {"f32_streamed", false, 640, {f32}, dense, Fill::kNone, true},
      {"f32_flood", false, 320, {f32}, dense, Fill::kFlood},
      {"four_floats", false, 200, {normal}},
      {"several_targets", false, 200, {normal, f32, checker}, dense, Fill::kParity},
      {"sparse_bits", false, 1200, bits, sparse},
      {"sparse_f32", false, 700, {f32}, sparse},
      {"sparse_four_floats", false, 700, {normal}, sparse},
      {"sparse_in_slabs", false, 700, {normal}, sparse, Fill::kNone, false, Coverage::kConservative, "identity", 64},
      {"sparse_flood", false, 400, {f32}, sparse, Fill::kFlood},
      {"sparse_of_a_fine_mesh", true, 500, {position}, sparse},
      {"buckets", false, 600, {id}, buckets},
      {"buckets_of_positions", false, 600, {position}, buckets},
      {"buckets_thin", false, 600, {normal}, buckets, Fill::kNone, false, Coverage::kThin},
      {"buckets_in_slabs", false, 600, {id}, buckets, Fill::kNone, false, Coverage::kConservative, "identity", 64},
      {"buckets_of_a_fine_mesh", true, 300, {id}, buckets},
  };
}

// Bytes.
struct Peak {
  bool known = false;
  uint64_t predicted = 0, measured = 0;
};

// Runs a job; what it takes beside what a small one of its kind has taken already: threads, code and tables are no part
// of a prediction.
void RunForPeak(const TriangleMesh& mesh, const VoxelizeRequest& request, const PlanLimits& limits, bool streamed,
                Peak& out) {
  const JobContext job;
  VoxelizeRequest small = request;
  small.grid = GridRequest();
  small.grid.resolution = 8;
  ASSERT_TRUE(Voxelize(testing::Cube(1), small, {job}).ok());
  ReleaseIdlePages();
  malloc_trim(0);
  if (!ResetPeak()) return;
  const uint64_t before = StatusBytes("VmRSS");
  Plan plan;
  const PlanHook on_plan = testing::KeepPlan(plan);
  if (streamed) {
    Swallow sink;
    const auto stats = VoxelizeTo(mesh, request, {job, limits, on_plan}, sink);
    ASSERT_TRUE(stats.ok()) << stats.status();
    EXPECT_GT(sink.bytes(), 0u);
  } else {
    const auto result = Voxelize(mesh, request, {job, limits, on_plan});
    ASSERT_TRUE(result.ok()) << result.status();
  }
  out = {true, plan.peak_bytes, StatusBytes("VmHWM") - before};
  ::testing::Test::RecordProperty("predicted_bytes", std::to_string(out.predicted));
  ::testing::Test::RecordProperty("measured_bytes", std::to_string(out.measured));
}

class PlanMemory : public ::testing::TestWithParam<Case> {};

TEST_P(PlanMemory, PredictsThePeakWithinAFactorOfOneAndAHalf) {
  if (testing::kSanitized) GTEST_SKIP() << "resident memory is a sanitizer's here";
  const Case& c = GetParam();
  const TriangleMesh mesh = c.fine ? testing::Torus(707) : testing::BumpySphere(60, 3);
  VoxelizeRequest request;
  request.targets = c.targets;
  request.result = c.result;
  request.fill = c.fill;
  request.coverage = c.coverage;
  request.vertex_shader.name = c.vertex_shader;
  request.grid.resolution = c.resolution;
  PlanLimits limits;
  limits.slab_depth = c.slab_depth;
  if (c.streamed) limits.slab_bytes = 64 << 20;
  Peak peak;
  ASSERT_NO_FATAL_FAILURE(RunForPeak(mesh, request, limits, c.streamed, peak));
  if (!peak.known) GTEST_SKIP() << "the peak of this process cannot be reset here";
  EXPECT_LT(double(peak.predicted), 1.5 * double(peak.measured))
      << peak.predicted << " predicted, " << peak.measured << " measured";
  EXPECT_LT(double(peak.measured), 1.5 * double(peak.predicted))
      << peak.predicted << " predicted, " << peak.measured << " measured";
}

INSTANTIATE_TEST_SUITE_P(Kinds, PlanMemory, ::testing::ValuesIn(Cases()),
                         [](const auto& test) { return test.param.name; });

// Grids of gigabytes of voxels, of which a mesh touches next to nothing: what they take is not the mesh's.
struct LargeCase {
  std::string name;
  bool speck;   // one small triangle, otherwise a cube across the grid
  int64_t dim;  // voxels along x; as many along y and z, up to 2048
  ResultKind result;
  std::vector<TargetSpec> targets = VoxelizeRequest().targets;
  Fill fill = Fill::kNone;
  bool streamed = false;
  Coverage coverage = Coverage::kConservative;
  uint64_t slab_bytes = PlanLimits().slab_bytes;
  int64_t slab_depth = 0;  // 0: the plan's choice
};

void PrintTo(const LargeCase& c, std::ostream* out) {
  *out << c.name;
}

std::vector<LargeCase> LargeCases() {
  const TargetSpec f32 = FloatTarget(1, Blend::kMax, {"occupancy", {}});
  const TargetSpec average = FloatTarget(3, Blend::kAverage, {"position", {}});
  TargetSpec first = FloatTarget(1, Blend::kFirst, {"triangle_id", {}});
  first.format = VoxelFormat::kU32;
  TargetSpec byte = first;
  byte.format = VoxelFormat::kU8;
  TargetSpec checker;
  checker.shader = {"checker", {}};
  const std::vector<TargetSpec> bits = VoxelizeRequest().targets;
  const auto dense = ResultKind::kDense, sparse = ResultKind::kSparse, buckets = ResultKind::kBuckets;
  const auto all = Coverage::kConservative, thin = Coverage::kThin;
  return {
      {"sparse_bits_of_a_speck", true, 2048, sparse},
      {"sparse_values_of_a_speck", true, 1024, sparse, {f32}},
      {"sparse_bits", false, 1200, sparse},
      {"sparse_bits_in_slabs_of_the_callers", false, 700, sparse, bits, Fill::kNone, false, all, 512 << 20, 304},
      {"sparse_flood_of_a_speck", true, 1000, sparse, bits, Fill::kFlood},
      {"sparse_flood_of_values", false, 300, sparse, {f32}, Fill::kFlood, false, thin},
      {"sparse_beyond_codes", true, 17'000, sparse},
      {"sparse_averages", false, 500, sparse, {average, first}},
      {"buckets_of_a_speck", true, 2048, buckets, {first}},
      {"buckets_of_a_cube", false, 500, buckets, {average}},
      {"bits_streamed", true, 1000, dense, bits, Fill::kNone, true, all, 64 << 20},
      {"bits_parity_streamed", false, 1000, dense, bits, Fill::kParity, true, all, 64 << 20},
      {"bits_flood_streamed", false, 700, dense, bits, Fill::kFlood, true, all, 32 << 20},
      {"bytes_flood", false, 400, dense, {byte}, Fill::kFlood, false, thin},
      {"several_streamed", false, 400, dense, {average, first, checker}, Fill::kNone, true, all, 64 << 20},
      {"several_flood_in_slabs", false, 250, dense, {average, checker}, Fill::kFlood, false, all, 512 << 20, 104},
  };
}

class PlanMemoryOfLargeGrids : public ::testing::TestWithParam<LargeCase> {};

TEST_P(PlanMemoryOfLargeGrids, IsWhatTheyTakeAndNoLess) {
  if (testing::kSanitized) GTEST_SKIP() << "resident memory is a sanitizer's here";
  const LargeCase& c = GetParam();
  TriangleMesh mesh = testing::MakeMesh({{5, 5, 5}, {9, 5, 6}, {5, 8, 9}}, {{0, 1, 2}});
  if (!c.speck) {
    mesh = testing::Cube(0.98);
    for (Vec3d& p : mesh.positions) p = (p + Vec3d{0.01, 0.01, 0.01}) * double(c.dim);
  }
  VoxelizeRequest request;
  const int64_t other = c.dim <= 2048 ? c.dim : 300;
  request.grid.dims = {c.dim, other, other};
  request.grid.origin = Vec3d{};
  request.grid.voxel_size = Vec3d{1, 1, 1};
  request.targets = c.targets;
  request.result = c.result;
  request.fill = c.fill;
  request.coverage = c.coverage;
  PlanLimits limits;
  limits.slab_bytes = c.slab_bytes;
  limits.slab_depth = c.slab_depth;
  Peak peak;
  ASSERT_NO_FATAL_FAILURE(RunForPeak(mesh, request, limits, c.streamed, peak));
  if (!peak.known) GTEST_SKIP() << "the peak of this process cannot be reset here";
  constexpr uint64_t kFew = 4 << 20;  // bytes that threads and allocators keep
  // Lengths of lists are estimates; what they come to take is counted.
  const double estimated = c.result == ResultKind::kDense ? 1 : 1.1;
  EXPECT_LE(double(peak.measured), estimated * double(peak.predicted + kFew)) << peak.predicted << " predicted";
  EXPECT_LE(double(peak.predicted), 1.4 * double(peak.measured + 2 * kFew)) << peak.measured << " measured";
}

INSTANTIATE_TEST_SUITE_P(Kinds, PlanMemoryOfLargeGrids, ::testing::ValuesIn(LargeCases()),
                         [](const auto& test) { return test.param.name; });

// Rows of a grid have whole words of 32 voxels while it is flooded, those of its result have not.
TEST(PlanMemoryOfNarrowGrids, FloodsOfFewVoxelsARowAreWhatTheyTake) {
  if (testing::kSanitized) GTEST_SKIP() << "resident memory is a sanitizer's here";
  const int64_t dims[3] = {33, 2500, 2500};
  TriangleMesh mesh = testing::Cube(0.98);
  for (Vec3d& p : mesh.positions) {
    for (int a = 0; a < 3; ++a) p[a] = (p[a] + 0.01) * double(dims[a]);
  }
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
    VoxelizeRequest request;
    request.grid.dims = {dims[0], dims[1], dims[2]};
    request.grid.origin = Vec3d{};
    request.grid.voxel_size = Vec3d{1, 1, 1};
    request.fill = Fill::kFlood;
    request.coverage = coverage;
    Peak peak;
    ASSERT_NO_FATAL_FAILURE(RunForPeak(mesh, request, PlanLimits(), false, peak));
    if (!peak.known) GTEST_SKIP() << "the peak of this process cannot be reset here";
    constexpr uint64_t kFew = 4 << 20;  // bytes that threads and allocators keep
    EXPECT_LE(peak.measured, peak.predicted + kFew) << Name(coverage);
    EXPECT_LE(double(peak.predicted), 1.4 * double(peak.measured + 2 * kFew)) << Name(coverage);
  }
}

// What is refused costs little: looking at a grid takes memory by its mesh, not by its voxels.
TEST(PlanMemoryOfRefusals, GridsOfAnySizeAreLookedAtInLittleMemory) {
  if (testing::kSanitized) GTEST_SKIP() << "resident memory is a sanitizer's here";
  VoxelizeRequest request;
  request.grid.resolution = 8;
  request.result = ResultKind::kSparse;
  const JobContext job;
  ASSERT_TRUE(Voxelize(testing::Cube(1), request, {job}).ok());  // threads, code and tables
  if (!ResetPeak()) GTEST_SKIP() << "the peak of this process cannot be reset here";
  const uint64_t before = StatusBytes("VmRSS");
  for (const Fill fill : {Fill::kNone, Fill::kFlood}) {
    for (const int64_t resolution : {3000, 20'000, 100'000}) {
      request.grid.resolution = resolution;
      request.coverage = Coverage::kThin;
      request.fill = fill;
      PlanLimits limits;
      limits.max_result_bytes = 8 << 20;
      EXPECT_EQ(Voxelize(testing::Cube(1), request, {job, limits}).status().code(),
                absl::StatusCode::kResourceExhausted);
    }
  }
  EXPECT_LT(StatusBytes("VmHWM") - before, uint64_t{32} << 20);
}

// Nor do lines that meet the same triangle thousands of times, or triangles that each go through the whole grid.
TEST(PlanMemoryOfRefusals, TrianglesThatRepeatAreLookedAtInLittleMemory) {
  if (testing::kSanitized) GTEST_SKIP() << "resident memory is a sanitizer's here";
  VoxelizeRequest request;
  request.grid.resolution = 8;
  request.result = ResultKind::kSparse;
  request.fill = Fill::kParity;
  const JobContext job;
  ASSERT_TRUE(Voxelize(testing::Cube(1), request, {job}).ok());  // threads, code and tables
  const TriangleMesh mesh =
      testing::MakeMesh({{0, 0, 0}, {0.5, 1, 0}, {1, 0, 1}}, std::vector<std::array<uint32_t, 3>>(30'000, {0, 1, 2}));
  if (!ResetPeak()) GTEST_SKIP() << "the peak of this process cannot be reset here";
  const uint64_t before = StatusBytes("VmRSS");
  request.grid.resolution = 1500;
  PlanLimits limits;
  limits.max_result_bytes = 1 << 20;
  EXPECT_EQ(Voxelize(mesh, request, {job, limits}).status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_LT(StatusBytes("VmHWM") - before, uint64_t{64} << 20);
}

}  // namespace
}  // namespace voxelpipe
