#include "mesh/report.h"

#include <chrono>

#include "gtest/gtest.h"
#include "mesh/weld.h"
#include "support/meshes/meshes.h"

namespace voxelpipe {
namespace {

using namespace testing;

TEST(ReportTest, ClosedMeshesHaveNoOpenEdges) {
  EXPECT_EQ(*CountOpenEdges({}, Cube(1)), 0u);
  EXPECT_EQ(*CountOpenEdges({}, Torus(9)), 0u);
  EXPECT_EQ(*CountOpenEdges({}, BumpySphere(7, 1)), 0u);
}

TEST(ReportTest, AMissingTriangleOpensThreeEdges) {
  TriangleMesh mesh = Cube(1);
  mesh.triangles.pop_back();
  EXPECT_EQ(*CountOpenEdges({}, mesh), 3u);
}

TEST(ReportTest, EqualPositionsAreWelded) {
  const TriangleMesh cube = Cube(1);
  std::vector<Vec3d> split;
  std::vector<std::array<uint32_t, 3>> triangles;
  for (const auto& t : cube.triangles) {
    const uint32_t v = uint32_t(split.size());
    for (const uint32_t i : t) split.push_back(cube.positions[i]);
    triangles.push_back({v, v + 1, v + 2});
  }
  split[0].x = -0.0;  // -0 = +0
  EXPECT_EQ(*CountOpenEdges({}, MakeMesh(split, triangles)), 0u);
}

TEST(ReportTest, DegenerateEdgesAreNone) {
  // Two corners equal: the two long edges cancel out, the short one is no edge.
  EXPECT_EQ(*CountOpenEdges({}, MakeMesh({{0, 0, 0}, {1, 0, 0}, {1, 0, 0}}, {{0, 1, 2}})), 0u);
  EXPECT_EQ(*CountOpenEdges({}, MakeMesh({}, {})), 0u);
}

TEST(ReportTest, CountsAndBox) {
  TriangleMesh mesh = Cube(2);
  mesh.positions.push_back({50, 50, 50});  // no triangle uses it
  mesh.triangles.push_back({0, 1, 1});
  const MeshReport report = *ReportMesh({}, mesh);
  EXPECT_EQ(report.triangles, 13u);
  EXPECT_EQ(report.vertices, 9u);
  EXPECT_EQ(report.degenerate_triangles, 1u);
  EXPECT_EQ(report.min, (Vec3d{0, 0, 0}));
  EXPECT_EQ(report.max, (Vec3d{2, 2, 2}));
  const MeshReport box = *BoxReport({}, mesh);
  EXPECT_EQ(box.triangles, 13u);
  EXPECT_EQ(box.vertices, 9u);
  EXPECT_EQ(box.degenerate_triangles, 0u) << "not looked for";
  EXPECT_EQ(box.min, report.min);
  EXPECT_EQ(box.max, report.max);
}

TEST(ReportTest, EveryStepOfAnExaminationEndsWithItsJob) {
  JobContext job;
  job.Cancel();
  const TriangleMesh mesh = Cube(1);
  EXPECT_EQ(Weld(job, mesh.positions).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(CountOpenEdges(job, mesh).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(CountDegenerateTriangles(job, mesh).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(BoxReport(job, mesh).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(ReportMesh(job, mesh).status().code(), absl::StatusCode::kCancelled);
}

// The mesh takes far longer than the job has.
TEST(ReportTest, AnExaminationEndsMidway) {
  const TriangleMesh mesh = Soup(400'000, 10, 7);
  JobContext job;
  job.set_deadline(JobContext::Clock::now() + std::chrono::milliseconds(5));
  EXPECT_EQ(ReportMesh(job, mesh).status().code(), absl::StatusCode::kDeadlineExceeded);
}

TEST(ReportTest, OpenEdgesAreChargedToTheJob) {
  MemoryBudget small(500);
  JobContext job;
  job.set_memory(&small);
  EXPECT_EQ(CountOpenEdges(job, Torus(9)).status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(small.used_bytes(), 0u);
}

}  // namespace
}  // namespace voxelpipe
