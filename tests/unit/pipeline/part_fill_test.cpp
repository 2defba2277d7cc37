// Fills of parts: each part decides about its inside alone, and the one of the highest rank owns a voxel.
#include <algorithm>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "mesh/placed_mesh.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using testing::Cube;
using testing::FloatAt;
using ::testing::HasSubstr;
using testing::RunPipeline;
using testing::ValueAt;

// A cube of 8 voxels, one of 4 in it, and one of 4 that begins in both and ends outside; each a placed mesh.
class PartFillTest : public ::testing::Test {
 protected:
  static PlacedMesh Entry(double size, double x, double y, double z, const char* name) {
    PlacedMesh placed;
    placed.mesh = std::make_shared<const TriangleMesh>(Cube(size));
    placed.matrix.m[0][3] = x;
    placed.matrix.m[1][3] = y;
    placed.matrix.m[2][3] = z;
    placed.name = name;
    return placed;
  }
  TriangleMesh Assembly() const {
    const JobContext job;
    absl::StatusOr<TriangleMesh> mesh = PlaceMeshes(job, placed_);
    EXPECT_TRUE(mesh.ok()) << mesh.status();
    return mesh.ok() ? *std::move(mesh) : TriangleMesh{};
  }
  static VoxelizeRequest Labels() {
    VoxelizeRequest request;
    request.grid.dims = {12, 8, 8};
    request.grid.voxel_size = Vec3d{1, 1, 1};
    request.grid.origin = Vec3d{0, 0, 0};
    request.coverage = Coverage::kNone;
    request.fill = Fill::kParity;
    request.parts.scope = PartScope::kFile;
    request.targets = {{.format = VoxelFormat::kU8, .blend = Blend::kReplace, .shader = {"label", {}}}};
    return request;
  }
  std::map<int, int> Counts(const VoxelizeRequest& request) const {
    const VoxelizeResult result = RunPipeline(Assembly(), request);
    std::map<int, int> counts;
    if (result.targets.empty()) return counts;
    for (uint64_t n = 0; n < 12 * 8 * 8; ++n) ++counts[ValueAt<uint8_t>(result.targets[0], n)];
    return counts;
  }

  std::vector<PlacedMesh> placed_ = {Entry(8, 0, 0, 0, "outer"), Entry(4, 2, 2, 2, "inner"), Entry(4, 5, 3, 3, "rod")};
};

TEST_F(PartFillTest, TheLastPartOwnsWhatSeveralContain) {
  for (const Fill fill : {Fill::kParity, Fill::kNonzero}) {
    VoxelizeRequest request = Labels();
    request.fill = fill;
    const std::map<int, int> counts = Counts(request);
    EXPECT_EQ(counts.at(3), 4 * 4 * 4);
    EXPECT_EQ(counts.at(2), 64 - 1 * 3 * 3) << "the rod takes a layer of it";
    EXPECT_EQ(counts.at(0), 768 - 512 - 1 * 4 * 4);
    EXPECT_EQ(counts.at(1), 768 - counts.at(0) - counts.at(2) - counts.at(3));
  }
}

TEST_F(PartFillTest, PrioritiesAndLabelsAreThoseOfTheRules) {
  VoxelizeRequest request = Labels();
  request.parts.priorities = {{"inner", 5}};
  request.parts.labels = {{"*", 9}, {"in*", 7}};
  const std::map<int, int> counts = Counts(request);
  EXPECT_EQ(counts.at(7), 64);
  EXPECT_EQ(counts.at(9), 768 - counts.at(0) - 64);
}

TEST_F(PartFillTest, ASolidThatIsTurnedInsideOutIsFilledToo) {
  placed_[1].matrix.m[0][0] = -1;  // a mirror, with its corners swapped, ...
  placed_[1].matrix.m[0][3] = 6;
  TriangleMesh inside_out = Cube(4);
  for (auto& t : inside_out.triangles) std::swap(t[1], t[2]);  // ... and one that is inside out
  placed_[2].mesh = std::make_shared<const TriangleMesh>(inside_out);
  VoxelizeRequest request = Labels();
  request.fill = Fill::kNonzero;
  const std::map<int, int> counts = Counts(request);
  EXPECT_EQ(counts.at(3), 64);
  EXPECT_EQ(counts.at(2), 64 - 9);
}

TEST_F(PartFillTest, ReplaceHoldsTheOwnerAlone) {
  // With fragments: of the wall of the inner cube nothing is seen inside the rod, which owns these voxels.
  VoxelizeRequest request = Labels();
  request.coverage = Coverage::kConservative;
  request.targets.push_back({.format = VoxelFormat::kU32, .blend = Blend::kReplace, .shader = {"triangle_id", {}}});
  request.targets.push_back({.format = VoxelFormat::kU32, .blend = Blend::kFirst, .shader = {"triangle_id", {}}});
  request.targets.push_back({.format = VoxelFormat::kU32, .blend = Blend::kMax, .shader = {"triangle_id", {}}});
  request.targets[1].clear = request.targets[2].clear = request.targets[3].clear = 1000;
  const VoxelizeResult result = RunPipeline(Assembly(), request);
  ASSERT_EQ(result.targets.size(), 4u);
  const auto at = [](int x, int y, int z) { return uint64_t(x + 12 * (y + 8 * z)); };
  // The centre of the rod, 7 5 5: the rod's own inside, without any fragment of its own; the wall of the outer cube is
  // far, that of the inner one ends at 6.
  EXPECT_EQ(ValueAt<uint8_t>(result.targets[0], at(6, 4, 4)), 3) << "inside the rod, at the wall of the inner cube";
  EXPECT_EQ(ValueAt<uint32_t>(result.targets[1], at(6, 4, 4)), 1000u) << "ids differ from triangle to triangle: clear";
  EXPECT_LT(ValueAt<uint32_t>(result.targets[2], at(6, 4, 4)), 24u) << "the first fragment is the inner cube's";
  EXPECT_GE(ValueAt<uint32_t>(result.targets[2], at(6, 4, 4)), 12u);
  EXPECT_LT(ValueAt<uint32_t>(result.targets[3], at(6, 4, 4)), 24u);
  EXPECT_GE(ValueAt<uint32_t>(result.targets[1], at(5, 4, 4)), 24u) << "the rod's own wall";
  EXPECT_EQ(result.stats.backend, "cpu");
}

TEST_F(PartFillTest, EveryKindOfResultAndSlabIsTheSame) {
  VoxelizeRequest request = Labels();
  request.coverage = Coverage::kThin;
  request.targets.push_back({.format = VoxelFormat::kF32, .components = 3, .shader = {"position", {}}});
  request.targets[1].blend = Blend::kReplace;
  request.targets.push_back({.format = VoxelFormat::kBit, .blend = Blend::kReplace, .fill_values = {0}});
  const TriangleMesh mesh = Assembly();
  const VoxelizeResult whole = RunPipeline(mesh, request);
  PlanLimits limits;
  limits.slab_depth = 8;
  request.grid.dims = {12, 8, 20};
  const VoxelizeResult deep = RunPipeline(mesh, request);
  const JobContext job;
  const auto slabs = Voxelize(mesh, request, {job, limits});
  ASSERT_TRUE(slabs.ok()) << slabs.status();
  EXPECT_EQ(slabs->stats.occupied, deep.stats.occupied);
  EXPECT_EQ(slabs->stats.odd_columns, 0u);
  for (size_t t = 0; t < deep.targets.size(); ++t) {
    ASSERT_EQ(slabs->targets[t].size(), deep.targets[t].size());
    EXPECT_TRUE(
        std::equal(deep.targets[t].data(), deep.targets[t].data() + deep.targets[t].size(), slabs->targets[t].data()))
        << t;
  }
  request.grid.dims = {12, 8, 8};
  request.result = ResultKind::kSparse;
  const VoxelizeResult sparse = RunPipeline(mesh, request);
  EXPECT_EQ(sparse.stats.occupied, whole.stats.occupied);
  EXPECT_EQ(sparse.listed_voxels(), whole.stats.occupied);
}

TEST_F(PartFillTest, EachPartIsFilledWithItsMotion) {
  placed_[0].motion = RigidMotionNumbers{{1, 0, 0}, {}, {}};
  placed_[2].motion = RigidMotionNumbers{{0, 0, 3}, {}, {}};
  VoxelizeRequest request = Labels();
  request.vertex_shader.parameters["linear_velocity"] = {0, 5, 0};
  request.targets = {
      {.format = VoxelFormat::kF32, .components = 3, .blend = Blend::kReplace, .shader = {"velocity", {}}}};
  const VoxelizeResult result = RunPipeline(Assembly(), request);
  ASSERT_EQ(result.targets.size(), 1u);
  const auto at = [&](int x, int y, int z, int c) {
    return FloatAt(result.targets[0], uint64_t(x + 12 * (y + 8 * z)) * 3 + uint64_t(c));
  };
  EXPECT_EQ(at(1, 1, 1, 0), 1);
  EXPECT_EQ(at(1, 1, 1, 1), 5);
  EXPECT_EQ(at(3, 3, 3, 0), 0);
  EXPECT_EQ(at(3, 3, 3, 1), 5);
  EXPECT_EQ(at(7, 5, 5, 2), 3);
  EXPECT_TRUE(result.stats.warnings.empty());
}

TEST_F(PartFillTest, WhatCannotBeIsRefused) {
  VoxelizeRequest request = Labels();
  request.coverage = Coverage::kConservative;
  request.fill = Fill::kFlood;
  EXPECT_THAT(std::string(testing::RunError(Assembly(), request).message()), HasSubstr("parts take parity or nonzero"));
  request = Labels();
  request.parts.labels = {{"rod", 256}};
  EXPECT_EQ(testing::RunError(Assembly(), request).message(),
            "targets[0].format: u8 does not hold the label 256 exactly; f16 holds all of them");
  request = Labels();
  request.parts.labels = {{"sail", 3}};
  const VoxelizeResult result = RunPipeline(Assembly(), request);
  ASSERT_FALSE(result.stats.warnings.empty());
  EXPECT_EQ(result.stats.warnings.kept()[0].code, WarningCode::kPartNotFound);
  EXPECT_THAT(result.stats.warnings.kept()[0].text, HasSubstr("'outer', 'inner', 'rod'"));
}

}  // namespace
}  // namespace voxelpipe
