// The table of parts of a result: what it says of each part, and that it comes with every kind of result.
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "job/memory_sink.h"
#include "mesh/parts/open_edges.h"
#include "mesh/placed_mesh.h"
#include "mesh/report.h"
#include "pipeline/estimate.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using testing::Cube;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::RunPipeline;
using testing::ValueAt;

// Cubes of the given sizes, each moved along x.
TriangleMesh Cubes(const std::vector<std::pair<double, double>>& sizes_and_places, bool last_is_open = false) {
  std::vector<PlacedMesh> list;
  for (const auto& [size, x] : sizes_and_places) {
    TriangleMesh cube = Cube(size);
    if (last_is_open && list.size() + 1 == sizes_and_places.size()) {
      cube.triangles.pop_back();
      --cube.parts[0].triangle_count;
    }
    PlacedMesh& placed = list.emplace_back();
    placed.mesh = std::make_shared<const TriangleMesh>(std::move(cube));
    placed.matrix.m[0][3] = x;
    placed.name = "cube " + std::to_string(list.size());
  }
  const JobContext job;
  absl::StatusOr<TriangleMesh> mesh = PlaceMeshes(job, list);
  EXPECT_TRUE(mesh.ok()) << mesh.status();
  return mesh.ok() ? *std::move(mesh) : TriangleMesh();
}

VoxelizeRequest ByFile(Fill fill) {
  VoxelizeRequest request;
  request.grid = testing::UnitGrid(16, 8, 8);
  request.coverage = Coverage::kNone;
  request.fill = fill;
  request.parts.scope = PartScope::kFile;
  return request;
}

TEST(PartTableTest, CountsTheVoxelsThatEachPartOwns) {
  const TriangleMesh mesh = Cubes({{8, 0}, {4, 6}});
  for (const Fill fill : {Fill::kParity, Fill::kNonzero}) {
    VoxelizeRequest request = ByFile(fill);
    const PartTable table = RunPipeline(mesh, request).parts;
    EXPECT_THAT(table.label, ElementsAre(1, 2));
    EXPECT_THAT(table.priority, ElementsAre(0, 0));
    EXPECT_THAT(table.triangles, ElementsAre(12, 12));
    EXPECT_THAT(table.open_edges, ElementsAre(0, 0));
    EXPECT_THAT(table.odd_columns, ElementsAre(0, 0));
    EXPECT_THAT(table.voxels, ElementsAre(512 - 2 * 16, 64)) << "the second cube takes two layers of the first";
    EXPECT_EQ(table.Name(0), "cube 1");
    EXPECT_EQ(table.Name(1), "cube 2");
    request.parts.priorities = {{"cube 1", 1}};
    EXPECT_THAT(RunPipeline(mesh, request).parts.voxels, ElementsAre(512, 64 - 2 * 16));
  }
}

// Whatever else is asked for: bits take another way than values, sparse results another than dense ones.
TEST(PartTableTest, CountsWhatLabelsShow) {
  const TriangleMesh mesh = Cubes({{7.5, 0.25}, {4, 6}, {3, 12.5}});
  for (const Coverage coverage : {Coverage::kNone, Coverage::kThin, Coverage::kCenter, Coverage::kConservative}) {
    VoxelizeRequest request = ByFile(Fill::kNonzero);
    request.coverage = coverage;
    request.targets = {{.format = VoxelFormat::kU8, .blend = Blend::kReplace, .shader = {"label", {}}}};
    const VoxelizeResult labels = RunPipeline(mesh, request);
    std::vector<uint64_t> shown(3);
    for (uint64_t n = 0; n < labels.grid.voxels(); ++n) {
      if (const auto label = ValueAt<uint8_t>(labels.targets[0], n); label > 0) ++shown[label - 1];
    }
    EXPECT_EQ(labels.parts.voxels, shown) << Name(coverage);
    std::vector<std::vector<TargetSpec>> others = {
        {{}}, {testing::FloatTarget(3, Blend::kMax, {"position", {}})}, {{}, request.targets[0]}};
    for (const std::vector<TargetSpec>& targets : others) {
      for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse}) {
        request.targets = targets;
        request.result = kind;
        EXPECT_EQ(RunPipeline(mesh, request).parts.voxels, shown) << Name(coverage) << ", " << Name(kind);
      }
    }
  }
}

TEST(PartTableTest, CountsOddColumnsOnce) {
  const TriangleMesh mesh = Cubes({{8, 0}, {4, 10}}, true);
  VoxelizeRequest request = ByFile(Fill::kParity);
  for (const Coverage coverage : {Coverage::kNone, Coverage::kConservative}) {
    request.coverage = coverage;
    const VoxelizeResult result = RunPipeline(mesh, request);
    EXPECT_EQ(result.parts.open_edges[0], 0u);
    EXPECT_EQ(result.parts.open_edges[1], 3u);
    EXPECT_EQ(result.parts.odd_columns[0], 0u);
    EXPECT_EQ(result.parts.odd_columns[1], *result.stats.odd_columns);
    EXPECT_LE(*result.stats.odd_columns, 16u);
  }
}

TEST(PartTableTest, AnOpenPartIsAWarningWithItsName) {
  const TriangleMesh mesh = Cubes({{8, 0}, {4, 10}}, true);
  VoxelizeRequest request = ByFile(Fill::kParity);
  const VoxelizeResult result = RunPipeline(mesh, request);
  ASSERT_EQ(result.stats.warnings.kept().size(), 1u);
  const Warning& warning = result.stats.warnings.kept()[0];
  EXPECT_EQ(warning.code, WarningCode::kPartOpen);
  EXPECT_EQ(warning.place, "parts[1]");
  EXPECT_THAT(warning.text, HasSubstr("'cube 2' has 3 open edges"));
  request.strict = true;
  EXPECT_THAT(std::string(testing::RunError(mesh, request).message()), HasSubstr("'cube 2'"));
  request.fill = Fill::kNone;
  request.coverage = Coverage::kThin;
  EXPECT_TRUE(testing::RunError(mesh, request).ok()) << "what is not filled may be open";
}

// As a server has them of its kept meshes: the table and the report take them.
TEST(PartTableTest, OpenEdgesOfPlacedMeshesMayBeKnown) {
  std::vector<PlacedMesh> list(2);
  for (PlacedMesh& placed : list) placed.mesh = std::make_shared<const TriangleMesh>(Cube(4));
  list[1].matrix.m[0][3] = 4;
  const JobContext job;
  const auto place = [&](uint64_t first, uint64_t second) {
    list[0].open_edges = first;
    list[1].open_edges = second;
    return *PlaceMeshes(job, list);
  };
  const VoxelizeRequest request = ByFile(Fill::kParity);
  EXPECT_THAT(RunPipeline(place(0, 7), request).parts.open_edges, ElementsAre(0, 7)) << "not counted";
  TriangleMesh mesh = place(0, 0);
  mesh.triangles.pop_back();
  --mesh.parts.back().triangle_count;
  EXPECT_EQ(*CountOpenEdges(job, mesh), 0u) << "not counted";
  mesh.placed[1].open_edges.reset();
  EXPECT_EQ(*CountOpenEdges(job, mesh), 3u);
  EXPECT_THAT(RunPipeline(mesh, request).parts.open_edges, ElementsAre(0, 3));
}

TEST(PartTableTest, WithoutAFillItHasNoCounts) {
  const TriangleMesh mesh = Cubes({{8, 0}, {4, 10}});
  VoxelizeRequest request = ByFile(Fill::kNone);
  request.coverage = Coverage::kThin;
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    request.result = kind;
    const VoxelizeResult result = RunPipeline(mesh, request);
    EXPECT_THAT(result.parts.label, ElementsAre(1, 2));
    EXPECT_TRUE(result.parts.voxels.empty() && result.parts.odd_columns.empty() && result.parts.open_edges.empty());
    EXPECT_EQ(HeaderOf(result).arrays.size(), HeaderOf(result).first_part_array() + 5);
  }
}

TEST(PartTableTest, TheWholeMeshHasNone) {
  VoxelizeRequest request = ByFile(Fill::kParity);
  request.parts = {};
  const VoxelizeResult result = RunPipeline(Cubes({{8, 0}, {4, 10}}), request);
  EXPECT_TRUE(result.parts.empty());
  EXPECT_EQ(HeaderOf(result).arrays.size(), 1u);
}

TEST(PartTableTest, AStreamEndsWithIt) {
  const TriangleMesh mesh = Cubes({{8, 0}, {4, 6}});
  VoxelizeRequest request = ByFile(Fill::kNonzero);
  request.targets = {{}, {.format = VoxelFormat::kU8, .blend = Blend::kReplace, .shader = {"label", {}}}};
  const VoxelizeResult whole = RunPipeline(mesh, request);
  const JobContext job;
  for (const int64_t depth : {0, 8, 3}) {
    PlanLimits limits;
    limits.slab_depth = depth;
    testing::KeepArrays sink;
    const auto stats = VoxelizeTo(mesh, request, {.job = job, .limits = limits}, sink);
    ASSERT_TRUE(stats.ok()) << stats.status();
    EXPECT_EQ(sink.arrays, testing::CopyArrays(whole)) << depth;
  }
}

TEST(PartTableTest, ThePlanCountsItsBytes) {
  const TriangleMesh mesh = Cubes({{8, 0}, {4, 6}});
  const VoxelizeRequest request = ByFile(Fill::kNonzero);
  const JobContext job;
  const absl::StatusOr<Plan> plan = EstimateVoxelization(mesh, request, job, {}, Delivery::kMemory);
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->result_bytes, BytesOf(HeaderOf(RunPipeline(mesh, request))));
}

// Two halves of a cube, each open along the cut, are closed only together.
TEST(OpenEdgesTest, OfPartsAlone) {
  TriangleMesh mesh = Cube(4);
  MeshPart half = mesh.parts[0];
  half.triangle_count = 6;
  mesh.parts = {half, half};
  mesh.parts[1].first_triangle = 6;
  mesh.parts[1].mesh = 1;
  mesh.parts[1].first_vertex = mesh.positions.size();
  const std::vector<Vec3d> positions = mesh.positions;
  mesh.positions.insert(mesh.positions.end(), positions.begin(), positions.end());
  for (size_t t = 6; t < 12; ++t) {
    for (uint32_t& vertex : mesh.triangles[t]) vertex += uint32_t(positions.size());
  }
  const JobContext job;
  PartSelection selection;
  const auto open_of = [&](PartScope scope) {
    selection.scope = scope;
    const absl::StatusOr<PartList> list = ListParts(job, mesh, selection);
    EXPECT_TRUE(list.ok()) << list.status();
    return *CountOpenEdges(job, mesh, *list, scope);
  };
  EXPECT_THAT(open_of(PartScope::kWhole), ElementsAre(0));
  const std::vector<uint64_t> open = open_of(PartScope::kMesh);
  ASSERT_EQ(open.size(), 2u);
  EXPECT_GT(open[0], 0u);
  EXPECT_EQ(open[0], open[1]) << "both have the same cut";
  mesh.positions[0].x = -0.0;  // equal to +0
  EXPECT_EQ(open_of(PartScope::kMesh), open);
}

}  // namespace
}  // namespace voxelpipe
