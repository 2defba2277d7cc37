#include "jobs/job.h"

#include <cstring>
#include <set>
#include <string>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include "mesh/mesh_bytes.h"
#include "pipeline/stages/backend.h"

namespace voxelpipe {
namespace {

// A glTF file with the unit cube: 8 corners, 12 triangles.
std::vector<uint8_t> CubeFile() {
  std::string buffer;
  for (int i = 0; i < 8; ++i) {
    const float corner[3] = {float(i & 1), float(i >> 1 & 1), float(i >> 2 & 1)};
    buffer.append(reinterpret_cast<const char*>(corner), sizeof corner);
  }
  const uint8_t indices[36] = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                               2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
  buffer.append(reinterpret_cast<const char*>(indices), sizeof indices);
  const std::string json = absl::StrCat(
      R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],)",
      R"("meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],)",
      R"("accessors":[{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3","min":[0,0,0],"max":[1,1,1]},)",
      R"({"bufferView":1,"componentType":5121,"count":36,"type":"SCALAR"}],)",
      R"("bufferViews":[{"buffer":0,"byteLength":96},{"buffer":0,"byteOffset":96,"byteLength":36}],)",
      R"("buffers":[{"byteLength":132,"uri":"data:application/octet-stream;base64,)", absl::Base64Escape(buffer),
      R"("}]})");
  return {json.begin(), json.end()};
}

ParsedConfig CubeConfig(Fill fill) {
  ParsedConfig config;
  config.request.grid.resolution = 8;
  config.request.fill = fill;
  return config;
}

// Both halves of a job.
absl::StatusOr<JobOutcome> RunJob(std::vector<uint8_t> file, const ParsedConfig& config, const JobLimits& limits,
                                  const JobContext& job, const std::function<void(const Plan&)>& planned) {
  const auto mesh = PrepareMesh(std::move(file), config, limits, job);
  if (!mesh.ok()) return mesh.status();
  const auto on_plan = [&](const Plan& plan) {
    if (planned) planned(plan);
    return absl::OkStatus();
  };
  return RunPrepared(**SelectBackend(BackendChoice::kCpu), **mesh, config, limits, job, on_plan);
}

TEST(JobTest, ACubeHasTheHandCountedVoxels) {
  const JobContext job;
  int plans = 0;
  const auto filled = RunJob(CubeFile(), CubeConfig(Fill::kParity), {}, job, [&](const Plan& plan) {
    ++plans;
    EXPECT_EQ(plan.result_bytes, 64u);
  });
  ASSERT_TRUE(filled.ok()) << filled.status();
  EXPECT_EQ(plans, 1);
  EXPECT_EQ(filled->result.stats.occupied, 512u);
  EXPECT_TRUE(filled->examined);
  EXPECT_EQ(filled->report.open_edges, 0u);
  EXPECT_EQ(filled->report.triangles, 12u);
  EXPECT_EQ(filled->report.max, (Vec3d{1, 1, 1}));
  EXPECT_GT(filled->peak_bytes, 64u);

  const auto shell = RunJob(CubeFile(), CubeConfig(Fill::kNone), {}, job, {});
  ASSERT_TRUE(shell.ok()) << shell.status();
  EXPECT_EQ(shell->result.stats.occupied, 296u);
  EXPECT_FALSE(shell->examined);
  EXPECT_EQ(shell->report.max, (Vec3d{1, 1, 1}));
  EXPECT_EQ(shell->report.vertices, 8u);
}

TEST(JobTest, TheRigCountsInThePeak) {
  std::vector<uint8_t> plain = CubeFile();
  std::string morphed(plain.begin(), plain.end());
  const std::string indices = R"("indices":1)";
  morphed.replace(morphed.find(indices), indices.size(), indices + R"(,"targets":[{"POSITION":0}])");
  const JobContext job;
  const auto without = RunJob(plain, CubeConfig(Fill::kNone), {}, job, {});
  const auto with = RunJob({morphed.begin(), morphed.end()}, CubeConfig(Fill::kNone), {}, job, {});
  ASSERT_TRUE(without.ok()) << without.status();
  ASSERT_TRUE(with.ok()) << with.status();
  EXPECT_GE(with->peak_bytes, without->peak_bytes + 2 * 96) << "positions before the morph, and their displacements";
}

TEST(JobTest, StagesBeginWithLoadAndFlattenAndAreReported) {
  std::set<std::string> reported;
  const JobContext job([&](std::string_view stage, double) { reported.emplace(stage); });
  const auto outcome = RunJob(CubeFile(), CubeConfig(Fill::kParity), {}, job, {});
  ASSERT_TRUE(outcome.ok()) << outcome.status();
  const auto& stages = outcome->result.stats.stages;
  ASSERT_GT(stages.size(), 2u);
  EXPECT_EQ(stages[0].first, "load");
  EXPECT_EQ(stages[1].first, "flatten");
  for (const auto& [stage, ms] : stages) {
    EXPECT_TRUE(reported.contains(stage)) << stage;
    EXPECT_GE(ms, 0);
  }
}

TEST(JobTest, ABrokenFileIsAnInvalidArgument) {
  const JobContext job;
  EXPECT_EQ(RunJob({}, CubeConfig(Fill::kNone), {}, job, {}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(RunJob({1, 2, 3, 4, 5}, CubeConfig(Fill::kNone), {}, job, {}).status().code(),
            absl::StatusCode::kInvalidArgument);
}

TEST(JobTest, LimitsHold) {
  const JobContext job;
  JobLimits limits;
  limits.load.max_file_bytes = 10;
  EXPECT_EQ(RunJob(CubeFile(), CubeConfig(Fill::kNone), limits, job, {}).status().code(),
            absl::StatusCode::kResourceExhausted);
  limits = {};
  limits.plan.max_result_bytes = 63;
  EXPECT_EQ(RunJob(CubeFile(), CubeConfig(Fill::kNone), limits, job, {}).status().code(),
            absl::StatusCode::kResourceExhausted);
}

TEST(JobTest, ACancelledOrLateJobStops) {
  JobContext cancelled;
  cancelled.Cancel();
  EXPECT_EQ(RunJob(CubeFile(), CubeConfig(Fill::kNone), {}, cancelled, {}).status().code(),
            absl::StatusCode::kCancelled);
  JobContext late;
  late.set_deadline(JobContext::Clock::now() - std::chrono::seconds(1));
  EXPECT_EQ(RunJob(CubeFile(), CubeConfig(Fill::kNone), {}, late, {}).status().code(),
            absl::StatusCode::kDeadlineExceeded);
}

TEST(JobTest, AnEstimateIsThePlanOfTheJob) {
  const JobContext job;
  ParsedConfig config = CubeConfig(Fill::kParity);
  config.request.vertex_shader = {"transform", {{"matrix", {2, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}}};
  Plan planned;
  ASSERT_TRUE(RunJob(CubeFile(), config, {}, job, [&](const Plan& plan) { planned = plan; }).ok());
  const auto mesh = PrepareMesh(CubeFile(), config, {}, job);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  const auto estimate = EstimateJob(**SelectBackend(BackendChoice::kCpu), **mesh, config, {}, job);
  ASSERT_TRUE(estimate.ok()) << estimate.status();
  EXPECT_EQ(estimate->plan.grid, planned.grid);
  EXPECT_EQ(estimate->plan.grid.dims, (std::array<int64_t, 3>{8, 4, 4})) << "the box is that of the shaded vertices";
  EXPECT_EQ(estimate->plan.result_bytes, planned.result_bytes);
  EXPECT_EQ(estimate->plan.peak_bytes, planned.peak_bytes);
  EXPECT_EQ(estimate->report.triangles, 12u);
}

TEST(JobTest, MeshesCountWhatFewBytesOfAFileMakeManyOf) {
  TriangleMesh mesh;
  const uint64_t before = MeshBytes(mesh);
  auto primitive = std::make_shared<Primitive>();
  auto morph = std::make_shared<MorphData>();
  morph->targets.resize(1000);
  primitive->morph = morph;
  auto rig = std::make_shared<Rig>();
  rig->parts.push_back({primitive, 0, -1, {}});
  rig->animations.resize(1000);
  rig->animations[0].fault = absl::InvalidArgumentError(std::string(5000, 'x'));
  rig->animations[1].channels.resize(1000);
  rig->nodes.resize(1);
  rig->nodes[0].weights.resize(1000);
  mesh.rig = rig;
  EXPECT_GE(MeshBytes(mesh) - before,
            1000 * (sizeof(MorphTarget) + sizeof(Animation) + sizeof(AnimationChannel) + sizeof(double)) + 5000);
}

}  // namespace
}  // namespace voxelpipe
