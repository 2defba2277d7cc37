#include "pipeline/warnings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "job/memory_sink.h"
#include "pipeline/batch.h"
#include "pipeline/estimate.h"
#include "pipeline/stages/backend.h"
#include "pipeline/voxelize.h"
#include "support/meshes/meshes.h"
#include "support/run.h"
#include "support/warnings.h"

namespace voxelpipe {
namespace {

using testing::Codes;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::Lines;

// A cube whose material has a base colour that no build decodes.
TriangleMesh Cube() {
  TriangleMesh mesh = testing::Cube(4);
  mesh.materials.resize(1);
  mesh.materials[0].base_color.texture = 0;
  mesh.parts[0].material = 0;
  mesh.parts[0].has_uv[0] = true;
  mesh.uv[0].resize(mesh.positions.size());
  mesh.textures.resize(1);
  mesh.textures[0].image = 0;
  mesh.images = {std::make_shared<Image>()};
  mesh.images[0]->fault = Warning{WarningCode::kTextureUndecodable, "image 0", "KTX2 is not decoded"};
  return mesh;
}

VoxelizeRequest Request(const char* shader) {
  VoxelizeRequest request;
  request.grid.resolution = 8;
  request.targets = {testing::FloatTarget(4, Blend::kReplace, {shader, {}})};
  return request;
}

// Each way to voxelize in this process.
std::vector<absl::StatusOr<VoxelizeStats>> RunAll(const TriangleMesh& mesh, const VoxelizeRequest& request) {
  std::vector<absl::StatusOr<VoxelizeStats>> all;
  const JobContext job;
  const auto stats_of = [](absl::StatusOr<VoxelizeResult> result) -> absl::StatusOr<VoxelizeStats> {
    if (!result.ok()) return result.status();
    return std::move(result->stats);
  };
  all.push_back(stats_of(Voxelize(mesh, request, {job})));
  class Nowhere final : public ResultSink {
   public:
    absl::Status Begin(const ResultHeader&) override { return absl::OkStatus(); }
    absl::Status Write(size_t, std::span<const uint8_t>) override { return absl::OkStatus(); }
  } sink;
  all.push_back(VoxelizeTo(mesh, request, {job}, sink));
  for (const Backend* device : Devices()) {
    const BatchItem item{&mesh, &request, &job, {}, [&](absl::StatusOr<VoxelizeResult> result) {
                           all.push_back(stats_of(std::move(result)));
                         }};
    VoxelizeBatch(*device, std::vector<BatchItem>(1, item), 1);
  }
  return all;
}

TEST(Warnings, TexturesAreSaidToWhoReadsThem) {
  const TriangleMesh mesh = Cube();
  for (const auto& stats : RunAll(mesh, Request("base_color"))) {
    ASSERT_TRUE(stats.ok()) << stats.status();
    EXPECT_THAT(Lines(stats->warnings), ElementsAre("image 0: KTX2 is not decoded"));
  }
  for (const char* shader : {"normal", "emissive"}) {
    for (const auto& stats : RunAll(mesh, Request(shader))) {
      ASSERT_TRUE(stats.ok()) << stats.status();
      EXPECT_THAT(Codes(stats->warnings), IsEmpty()) << shader;
    }
  }
  EXPECT_THAT(Codes(AllWarningsOf(mesh)), ElementsAre("texture_undecodable"));
}

TEST(Warnings, ThoseOfTheMeshComeWithEachUse) {
  TriangleMesh mesh = testing::Cube(4);
  mesh.warnings.Add(WarningCode::kNoScene, "", "the file has no scenes");
  for (int use = 0; use < 2; ++use) {
    for (const auto& stats : RunAll(mesh, Request("normal"))) {
      ASSERT_TRUE(stats.ok()) << stats.status();
      EXPECT_THAT(Codes(stats->warnings), ElementsAre("no_scene"));
    }
  }
}

TEST(Warnings, StrictMakesTheFirstOneTheError) {
  VoxelizeRequest request = Request("base_color");
  request.strict = true;
  for (const auto& stats : RunAll(Cube(), request)) {
    EXPECT_EQ(stats.status(), absl::InvalidArgumentError("image 0: KTX2 is not decoded"));
  }
  EXPECT_EQ(EstimateVoxelization(Cube(), request, JobContext(), {}, Delivery::kMemory).status(),
            absl::InvalidArgumentError("image 0: KTX2 is not decoded"));
  VoxelizeRequest other = Request("normal");
  other.strict = true;
  for (const auto& stats : RunAll(Cube(), other)) EXPECT_TRUE(stats.ok()) << stats.status();
}

TEST(Warnings, MasksThatDiscardEverythingAreSaid) {
  TriangleMesh mesh = Cube();
  mesh.images[0]->fault.reset();
  mesh.materials[0].alpha_mode = AlphaMode::kMask;
  mesh.materials[0].base_color_factor.w = 0.25f;
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    VoxelizeRequest request = Request("base_color");
    request.result = kind;
    for (const auto& stats : RunAll(mesh, request)) {
      ASSERT_TRUE(stats.ok()) << stats.status();
      EXPECT_EQ(stats->occupied, 0u);
      EXPECT_THAT(Codes(stats->warnings), ElementsAre("all_discarded"));
    }
    request.strict = true;
    for (const auto& stats : RunAll(mesh, request)) {
      EXPECT_THAT(std::string(stats.status().message()), HasSubstr("alpha masks discarded every fragment"));
    }
  }
  // Not where a target reads no material, nor where nothing lay in the grid.
  VoxelizeRequest both = Request("base_color");
  both.targets.push_back(TargetSpec{});
  for (const auto& stats : RunAll(mesh, both)) EXPECT_THAT(Codes(stats->warnings), IsEmpty());
  VoxelizeRequest beside = Request("base_color");
  beside.grid.dims = {4, 4, 4};
  beside.grid.origin = Vec3d{100, 0, 0};
  beside.grid.voxel_size = Vec3d{1, 1, 1};
  for (const auto& stats : RunAll(mesh, beside)) EXPECT_THAT(Codes(stats->warnings), ElementsAre("outside_grid"));
}

// Most of such a solid holds 0, which looks like a material, or black.
TEST(Warnings, AFillWithoutAValueIsSaid) {
  const TriangleMesh mesh = testing::Cube(4);
  VoxelizeRequest request = Request("material_id");
  request.fill = Fill::kParity;
  request.coverage = Coverage::kNone;
  request.targets[0].clear = 7;
  for (const auto& stats : RunAll(mesh, request)) {
    ASSERT_TRUE(stats.ok()) << stats.status();
    EXPECT_THAT(Codes(stats->warnings), ElementsAre("fill_has_no_value"));
    EXPECT_THAT(Lines(stats->warnings)[0], HasSubstr("targets[0]: 'material_id' has no value without a triangle: "
                                                     "filled voxels hold 7"));
  }
  request.strict = true;
  for (const auto& stats : RunAll(mesh, request)) {
    EXPECT_EQ(stats.status().code(), absl::StatusCode::kInvalidArgument);
  }
  request.targets[0].fill_values = {3};
  for (const auto& stats : RunAll(mesh, request)) EXPECT_TRUE(stats.ok()) << stats.status();
  for (const char* shader : {"occupancy", "constant", "position", "checker", "velocity"}) {
    VoxelizeRequest with_value = Request(shader);
    with_value.fill = Fill::kParity;
    for (const auto& stats : RunAll(mesh, with_value)) EXPECT_THAT(Codes(stats->warnings), IsEmpty()) << shader;
  }
  VoxelizeRequest shell = Request("base_color");
  for (const auto& stats : RunAll(mesh, shell)) EXPECT_THAT(Codes(stats->warnings), IsEmpty()) << "not filled";
}

TEST(Warnings, AGridThatNoTriangleReachesIsSaidWithBothBoxes) {
  const TriangleMesh mesh = testing::Cube(4);
  VoxelizeRequest request = Request("normal");
  request.grid.dims = {2, 2, 2};
  request.grid.origin = Vec3d{100, 0, 0};
  request.grid.voxel_size = Vec3d{1, 1, 1};
  request.grid.padding = 1;
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
      request.result = kind;
      if (kind == ResultKind::kBuckets && coverage == Coverage::kCenter) continue;  // no request
      request.coverage = coverage;
      for (const auto& stats : RunAll(mesh, request)) {
        ASSERT_TRUE(stats.ok()) << stats.status();
        ASSERT_THAT(Codes(stats->warnings), ElementsAre("outside_grid"));
        EXPECT_THAT(Lines(stats->warnings)[0],
                    HasSubstr("no triangle reaches the grid, (99, -1, -1) to (103, 3, 3); the mesh lies at ("));
      }
    }
  }
  // In the middle of the cube: its box reaches the grid, its triangles do not, and none covers a voxel's centre.
  request.result = ResultKind::kDense;
  const Vec3d first = mesh.positions[mesh.triangles[0][0]];
  request.grid.padding = 0;
  request.grid.origin = Vec3d{first.x / 8, first.y / 8, first.z / 8};
  request.grid.voxel_size = Vec3d{1e-3, 1e-3, 1e-3};
  request.coverage = Coverage::kCenter;
  for (const auto& stats : RunAll(mesh, request)) EXPECT_THAT(Codes(stats->warnings), IsEmpty());
}

TEST(Summary, TrianglesBesideAGridThatIsGivenAreCounted) {
  const TriangleMesh mesh = testing::Cube(4);  // 12 triangles
  VoxelizeRequest request = Request("normal");
  for (const auto& stats : RunAll(mesh, request)) {
    ASSERT_TRUE(stats.ok()) << stats.status();
    EXPECT_EQ(stats->triangles_outside, 0u) << "fitted";
  }
  Vec3d min{1e9, 1e9, 1e9}, max = min * -1.0;
  for (const Vec3d& p : mesh.positions) {
    for (int a = 0; a < 3; ++a) {
      min[a] = std::min(min[a], p[a]);
      max[a] = std::max(max[a], p[a]);
    }
  }
  const Vec3d size = max - min;
  request.grid.dims = {4, 4, 4};
  request.grid.voxel_size = size * 0.5;
  const auto outside = [&](const Vec3d& origin) {
    request.grid.origin = origin;
    std::vector<uint64_t> counts;
    for (const auto& stats : RunAll(mesh, request)) counts.push_back(stats.ok() ? stats->triangles_outside : ~0ull);
    for (const uint64_t count : counts) EXPECT_EQ(count, counts[0]);
    return counts[0];
  };
  EXPECT_EQ(outside(min), 0u);
  EXPECT_EQ(outside(min + size * 3.0), 12u);
  EXPECT_EQ(outside({min.x + size.x * 0.5, min.y, min.z}), 2u) << "the face at the lower end of x";
  EXPECT_EQ(outside({max.x, min.y, min.z}), 2u) << "touching is not outside";
  request.vertex_shader = {"transform", {{"matrix", {1, 0, 0, 100, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}}};
  EXPECT_EQ(outside(min), 12u) << "after the vertex shader";
  EXPECT_EQ(outside({min.x + 100, min.y, min.z}), 0u);
}

TEST(Warnings, FractionsThatBecomeWholeNumbersAreSaid) {
  const TriangleMesh mesh = testing::Cube(4);
  VoxelizeRequest request = Request("normal");
  request.targets[0].format = VoxelFormat::kU8;
  request.targets[0].components = 3;
  for (const auto& stats : RunAll(mesh, request)) {
    ASSERT_TRUE(stats.ok()) << stats.status();
    EXPECT_THAT(Codes(stats->warnings), ElementsAre("values_rounded"));
  }
  request.targets[0].scale = 255;
  for (const auto& stats : RunAll(mesh, request)) EXPECT_THAT(Codes(stats->warnings), IsEmpty());
  request.targets[0].scale.reset();
  request.targets[0].encoding = Encoding::kSnorm;
  for (const auto& stats : RunAll(mesh, request)) EXPECT_THAT(Codes(stats->warnings), IsEmpty());
  request.targets[0].encoding = Encoding::kLinear;
  request.targets[0].shader.name = "metallic_roughness";  // scaled as colours are
  for (const auto& stats : RunAll(mesh, request)) EXPECT_THAT(Codes(stats->warnings), IsEmpty());
  request.targets[0].shader.name = "position";
  for (const auto& stats : RunAll(mesh, request)) EXPECT_THAT(Codes(stats->warnings), ElementsAre("values_rounded"));
  request.targets[0].shader = {"constant", {{"value", {1, 0.5, 3}}}};
  for (const auto& stats : RunAll(mesh, request)) EXPECT_THAT(Codes(stats->warnings), ElementsAre("values_rounded"));
  request.targets[0].shader = {"constant", {{"value", {1, 2, 3}}}};
  for (const auto& stats : RunAll(mesh, request)) EXPECT_THAT(Codes(stats->warnings), IsEmpty());
}

}  // namespace
}  // namespace voxelpipe
